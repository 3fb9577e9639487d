"""The stand-in for reality: a rope that differs from the planner's, behind the `Robot` protocol."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.perturbation import ERRORS, Errors, displaced
from knotflow.execution.robot import Robot
from knotflow.execution.sight import Sight
from knotflow.simulation import REACH, RopeConfig, build_model, check_points, perturb_rope, pose

if TYPE_CHECKING:
    from knotflow.perception import Camera, RgbdImage, SimulatedCamera


@dataclass
class TwinConfig:
    """A twin, but for what is drawn."""

    level: int = 1
    """How far it is from the planner's model, see `simulation.perturbation`."""
    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope around which the twin's is drawn."""
    timestep: float = 0.005
    """Simulation time step, seconds: finer than the planner's."""
    contact_time: float = 0.02
    """Time constant of contacts and grasp, seconds."""
    reach: float = REACH
    """Farthest that the rope's centre line may lie from the fingers when they close, metres. A
    grasp farther off catches nothing."""
    home: tuple[float, float, float] = (0.0, 0.0, 0.3)
    """Where the gripper is at first, metres."""


class Twin:
    """A simulated robot and rope, with parameters drawn from stated ranges.

    Whoever plays with it has the truth (`points`); whoever executes a plan gets `robot()`, from
    which nothing but the `Robot` protocol is reached.

    Attributes:
        rope: what was drawn.
        times: (N,) seconds at the end of each move.
        trajectory: (N, V, 3) the rope then.
        missed: grasps that caught nothing.
    """

    def __init__(
        self,
        points: NDArray,
        config: TwinConfig,
        rng: np.random.Generator,
        camera: Camera | None = None,
    ) -> None:
        """Lay the rope down at points (V, 3), metres, and let it come to rest.

        Args:
            points: a shape of the nominal rope.
            config: the level, and what is not drawn.
            rng: draws the rope, and every error from then on; twins of generators with the same
                seed err alike, whatever is done with them.
            camera: where the camera is believed to be; without one there are no images.

        Raises:
            ShapeError: for points that are not a shape of the rope.
            ValueError: for a level that is none.
        """
        import mujoco

        drawn, swaying, grasping, seeing = rng.spawn(4)
        self.config = config
        self.rope = perturb_rope(config.rope, config.level, drawn)
        self._errors: Errors = ERRORS[config.level]
        self._grasping, self._seeing = grasping, seeing
        self._camera = _camera(camera, self.rope, self._errors, seeing) if camera else None
        points = check_points(points, config.rope).copy()
        points[:, 2] += self.rope.radius - config.rope.radius
        self._model = build_model(self.rope, config.timestep, config.contact_time)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = pose(points[None], self.rope)[0]
        self._vertices = [self._model.site(f"vertex_{i}").id for i in range(self.rope.num_vertices)]
        self._sway = _Sway(self._errors.actuation, swaying)
        self._commanded = np.array(config.home)
        self._held: NDArray | None = None
        self._closed = False
        self.missed = 0
        self.times: list[float] = []
        self.trajectory: list[NDArray[np.float64]] = []
        self._time, self._loose = 0.0, LAID
        while self._time < MOST_LAID and not self._at_rest():
            self._advance(self._commanded, LAID)

    @property
    def points(self) -> NDArray[np.float64]:
        """(V, 3) the rope as it truly lies, metres."""
        return self._data.site_xpos[self._vertices].copy()

    @property
    def grasped(self) -> bool:
        """Whether the fingers truly hold the rope."""
        return self._held is not None

    def robot(self) -> Robot:
        """All that whoever executes a plan may have."""
        hand = _Hand()
        _TWINS[hand] = self
        return hand

    def observe(self) -> RgbdImage:
        """See `Robot`; raises a RuntimeError for a twin without a camera."""
        if self._camera is None:
            raise RuntimeError("this twin has no camera: give Twin(..., camera=) one")
        return self._camera.capture(
            self.points, self._seeing, self.position, self._closed, self._time
        )

    def move_to(self, position: NDArray, seconds: float) -> None:
        """See `Robot`."""
        position = np.asarray(position, np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise ValueError(f"a position is three finite numbers in metres, got {position}")
        self._advance(position, seconds)
        self.times.append(self._time)
        self.trajectory.append(self.points)

    def grasp(self) -> None:
        """See `Robot`. The fingers close off the mark, and hold the rope where they caught it."""
        points, fingers = self.points, self.position
        fingers[:2] += self._grasping.normal(0.0, self._errors.grasp, 2)
        along = np.diff(points, axis=0)
        share = ((fingers - points[:-1]) * along).sum(1) / (along**2).sum(1)
        nearest = points[:-1] + np.clip(share, 0, 1)[:, None] * along
        distance = np.linalg.norm(nearest - fingers, axis=1)
        link = int(distance.argmin())
        self._closed = True
        self.missed += bool(distance[link] > self.config.reach)
        if self._held is None and distance[link] <= self.config.reach:
            self._held = (points[link] + points[link + 1]) / 2 - self.position
            self._data.mocap_pos[0] = self.position + self._held
            self._data.eq_active[link] = 1

    def release(self) -> None:
        """See `Robot`."""
        if self._held is not None:
            self._loose = SETTLED
        self._held, self._closed = None, False
        self._data.eq_active[:] = 0

    @property
    def position(self) -> NDArray[np.float64]:
        """See `Robot`: as the joints report it, with all that moving it does wrong."""
        return self._commanded + self._sway.at(self._time)

    def _advance(self, target: NDArray, seconds: float) -> None:
        """Simulate a straight move of the command to `target` (3,)."""
        import mujoco

        begin, steps = self._commanded, max(1, round(seconds / self.config.timestep))
        for step in range(1, steps + 1):
            self._commanded = begin + (target - begin) * step / steps
            place = self.position if self._held is None else self.position + self._held
            self._data.mocap_pos[0] = np.maximum(place, [-np.inf, -np.inf, self.rope.radius])
            if not self._at_rest():
                mujoco.mj_step(self._model, self._data)
                self._loose -= self.config.timestep
            self._time += self.config.timestep
        mujoco.mj_kinematics(self._model, self._data)

    def _at_rest(self) -> bool:
        """Whether the rope, let go long enough ago, hardly moves; then it stops altogether."""
        import mujoco

        if self._held is not None or self._loose > 0:
            return False
        if self._data.qvel.any():
            mujoco.mj_energyVel(self._model, self._data)
            speed = np.sqrt(2 * self._data.energy[1] / self._model.body_subtreemass[0])
            if speed > RESTING:
                return False
            self._data.qvel[:] = 0.0
        return True


@dataclass(frozen=True)
class TrueState:
    """The rope's true state, in place of vision: a yardstick that no lab has."""

    twin: Twin
    lost = False

    def points(self, robot: Robot, grasped: bool) -> NDArray[np.float64]:
        """See `RopeSource`."""
        return self.twin.points

    def look(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Sight:
        """See `Look`."""
        return Sight.of(self.twin.points)


LAID, MOST_LAID = 0.1, 2.0
"""Seconds that a rope moves at least and at most after it was laid down."""

SETTLED = 0.7
"""Seconds that it moves at least after it was let go. Once it is slow it then lies still until it
is grasped again: MuJoCo's friction yields a little to any force, so that a bent rope would creep by
centimetres while the gripper travels; a real one does not."""

RESTING = 0.004
"""Root mean square speed of the rope below which it comes to rest, metres per second."""


def _camera(
    camera: Camera, rope: RopeConfig, errors: Errors, rng: np.random.Generator
) -> SimulatedCamera:
    """A camera that is not quite where it is believed to be, in a light of its own."""
    from knotflow.perception import Appearance, CameraNoiseConfig, SimulatedCamera

    moved = displaced(camera, errors, rng)
    noise = CameraNoiseConfig(level=errors.camera_noise)
    return SimulatedCamera(moved, rope, noise, Appearance.draw(rng, noise))


class _Sway:
    """A smooth error in x and y: a normal draw every half second, and a smooth step between."""

    PERIOD = 0.5

    def __init__(self, size: float, rng: np.random.Generator) -> None:
        self._size, self._rng = size, rng
        self._knots = [np.zeros(3)]

    def at(self, time: float) -> NDArray[np.float64]:
        knot, share = divmod(time / self.PERIOD, 1.0)
        while len(self._knots) < knot + 2:
            self._knots.append(np.r_[self._rng.normal(0.0, self._size, 2), 0.0])
        begin, end = self._knots[int(knot) : int(knot) + 2]
        return begin + (end - begin) * share**2 * (3 - 2 * share)


class _Hand:
    """The five words, and no attribute that leads to the twin."""

    __slots__ = ("__weakref__",)

    def observe(self) -> RgbdImage:
        return _TWINS[self].observe()

    def move_to(self, position: NDArray, seconds: float) -> None:
        _TWINS[self].move_to(position, seconds)

    def grasp(self) -> None:
        _TWINS[self].grasp()

    def release(self) -> None:
        _TWINS[self].release()

    @property
    def position(self) -> NDArray[np.float64]:
        return _TWINS[self].position


_TWINS: WeakKeyDictionary[_Hand, Twin] = WeakKeyDictionary()

"""A simulated lab: a rope that differs from the planner's, behind the `Robot` protocol."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from knotflow.execution.robot import Observation, Robot, RobotWrapper
from knotflow.simulation import (
    GRASP_REACH,
    GRIPPER_ERROR_STD,
    RopeConfig,
    build_model,
    check_points,
    nearest_link,
    perturb_rope,
    pose,
)

if TYPE_CHECKING:
    from knotflow.perception import Camera, RgbdImage, SimulatedCamera

MIN_SETTLE_TIME, MAX_SETTLE_TIME = 0.1, 2.0
"""Seconds for which a rope is simulated after it was laid down, at least and at most."""

RELEASE_SETTLE_TIME = 0.7
"""Seconds at least after its release. Once slow it is frozen until the next grasp: with MuJoCo's
friction a bent rope would creep by centimetres."""

REST_SPEED = 0.004
"""Root mean square speed of the rope below which it comes to rest, metres per second."""


@dataclass(frozen=True)
class ErrorLevel:
    """Errors of a robot and its camera."""

    actuation: float  # standard deviation of the moving gripper's x and y, metres
    grasp: float  # the same where the fingers close, metres
    camera_shift: float  # largest error of the camera's position along each axis, metres
    camera_turn: float  # largest error of its orientation about each axis, radians
    camera_noise: float  # `CameraNoiseConfig.level` of its images


ERROR_LEVELS = (
    ErrorLevel(GRIPPER_ERROR_STD[0], GRIPPER_ERROR_STD[0], 0.0, 0.0, 0.0),
    ErrorLevel(GRIPPER_ERROR_STD[1], GRIPPER_ERROR_STD[1], 0.002, np.deg2rad(0.2), 1.0),
    ErrorLevel(GRIPPER_ERROR_STD[2], GRIPPER_ERROR_STD[2], 0.002, np.deg2rad(0.2), 1.0),
)
"""By level of `simulation.worlds`."""


def displace_camera(camera: Camera, errors: ErrorLevel, rng: np.random.Generator) -> Camera:
    """The camera with errors in its pose."""
    shift = rng.uniform(-1, 1, 3) * errors.camera_shift
    turn = Rotation.from_rotvec(rng.uniform(-1, 1, 3) * errors.camera_turn).as_matrix()
    return replace(camera, position=camera.position + shift, rotation=turn @ camera.rotation)


@dataclass
class TwinConfig:
    """Settings of a twin; its errors are drawn at random."""

    level: int = 1  # of perturbation, see `simulation.worlds`
    rope: RopeConfig = field(default_factory=RopeConfig)  # the nominal rope
    timestep: float = 0.005  # simulation time step, seconds: finer than the planner's
    contact_time: float = 0.02  # time constant of contacts and grasp, seconds
    reach: float = GRASP_REACH
    """Largest distance of the rope's centre line from the closing fingers, metres."""
    compute_time: float = 0.09
    """Seconds after each image for which the robot stands still: tracking and control take so long
    on one core."""
    home: tuple[float, float, float] = (0.0, 0.0, 0.3)  # the gripper's first position, metres


class Twin:
    """A simulated robot and rope, with randomly drawn parameters."""

    def __init__(
        self,
        points: NDArray,
        config: TwinConfig,
        rng: np.random.Generator,
        camera: Camera | None = None,
    ) -> None:
        """Lay down a rope (V, 3), metres, of the nominal size, and let it come to rest.

        Without the nominal `camera` there are no images.

        Raises:
            ShapeError: for points that are not a shape of the rope.
        """
        drawn, swaying, grasping, seeing = rng.spawn(4)
        self.config = config
        self.rope = perturb_rope(config.rope, config.level, drawn)
        self._errors = ERROR_LEVELS[config.level]
        self._grasping, self._seeing = grasping, seeing
        self._camera: SimulatedCamera | None = None
        if camera is not None:
            from knotflow.perception import Appearance, CameraNoiseConfig, SimulatedCamera

            noise = CameraNoiseConfig(level=self._errors.camera_noise)
            displaced = displace_camera(camera, self._errors, seeing)
            appearance = Appearance.draw(seeing, noise)
            self._camera = SimulatedCamera(displaced, self.rope, noise, appearance)
        points = check_points(points, config.rope).copy()
        points[:, 2] += self.rope.radius - config.rope.radius
        self._model = build_model(self.rope, config.timestep, config.contact_time)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = pose(points[None], self.rope)[0]
        self._vertices = [self._model.site(f"vertex_{i}").id for i in range(self.rope.num_vertices)]
        self._sway = _Sway(self._errors.actuation, swaying)
        self._commanded = np.array(config.home)
        self._grasp_offset: NDArray | None = None  # from the gripper to the held link's centre
        self._closed = False
        self.missed_grasps = 0  # grasps that caught nothing
        self.times: list[float] = []  # (N,) seconds at the end of each move
        self.trajectory: list[NDArray[np.float64]] = []  # (N, V, 3) metres, the rope then
        self._time, self._settle_time = 0.0, MIN_SETTLE_TIME
        while self._time < MAX_SETTLE_TIME and not self._at_rest():
            self._advance(self._commanded, MIN_SETTLE_TIME)

    @property
    def points(self) -> NDArray[np.float64]:
        """(V, 3) the true rope, metres."""
        return self._data.site_xpos[self._vertices].copy()

    @property
    def grasped(self) -> bool:
        """Whether the fingers truly hold the rope."""
        return self._grasp_offset is not None

    def robot(self) -> Robot:
        """The robot alone, as a lab has it."""
        return RobotWrapper(self)

    def observe(self) -> RgbdImage:
        if self._camera is None:
            raise RuntimeError("this twin has no camera: give Twin(..., camera=) one")
        place, closed = self.position, self._closed
        image = self._camera.capture(self.points, self._seeing, place, closed, self._time)
        if self.config.compute_time:
            self._advance(self._commanded, self.config.compute_time)
        return image

    def move_to(self, position: NDArray, seconds: float) -> None:
        position = np.asarray(position, np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise ValueError(f"a position is three finite numbers in metres, got {position}")
        self._advance(position, seconds)
        self.times.append(self._time)
        self.trajectory.append(self.points)

    def grasp(self) -> None:
        """The fingers hold the rope where they caught it."""
        points, fingers = self.points, self.position
        fingers[:2] += self._grasping.normal(0.0, self._errors.grasp, 2)
        link, distance = nearest_link(points, fingers)
        self._closed = True
        self.missed_grasps += bool(distance > self.config.reach)
        if not self.grasped and distance <= self.config.reach:
            self._grasp_offset = (points[link] + points[link + 1]) / 2 - self.position
            self._data.mocap_pos[0] = self.position + self._grasp_offset
            self._data.eq_active[link] = 1

    def release(self) -> None:
        if self.grasped:
            self._settle_time = RELEASE_SETTLE_TIME
        self._grasp_offset, self._closed = None, False
        self._data.eq_active[:] = 0

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) metres, errors included."""
        return self._commanded + self._sway.at(self._time)

    def _advance(self, target: NDArray, seconds: float) -> None:
        """Simulate a straight move of the command to `target` (3,)."""
        begin, steps = self._commanded, max(1, round(seconds / self.config.timestep))
        offset = np.zeros(3) if self._grasp_offset is None else self._grasp_offset
        for step in range(1, steps + 1):
            self._commanded = begin + (target - begin) * step / steps
            self._data.mocap_pos[0] = self.position + offset
            self._data.mocap_pos[0, 2] = max(self._data.mocap_pos[0, 2], self.rope.radius)
            if not self._at_rest():
                mujoco.mj_step(self._model, self._data)
                self._settle_time -= self.config.timestep
            self._time += self.config.timestep
        mujoco.mj_kinematics(self._model, self._data)

    def _at_rest(self) -> bool:
        """Whether the free rope hardly moves; then it is stopped."""
        if self.grasped or self._settle_time > 0:
            return False
        if self._data.qvel.any():
            mujoco.mj_energyVel(self._model, self._data)
            speed = np.sqrt(2 * self._data.energy[1] / self._model.body_subtreemass[0])
            if speed > REST_SPEED:
                return False
            self._data.qvel[:] = 0.0
        return True


@dataclass(frozen=True)
class TrueState:
    """The rope's true state, in place of vision."""

    twin: Twin
    lost = False

    def points(self, robot: Robot, grasped: bool) -> NDArray[np.float64]:
        return self.twin.points

    def estimate(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Observation:
        return Observation.of(self.twin.points)


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

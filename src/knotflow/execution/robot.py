"""What a lab implements: a robot; simulated faults; and observations of the rope."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation import RopeConfig, resample, state_or_none
from knotflow.topology import TopologicalState

if TYPE_CHECKING:
    from knotflow.perception import Camera, RgbdImage, StrandNetwork, Tracker


class Robot(Protocol):
    """A gripper above a table, and a camera that sees both.

    Positions are (3,) in metres in the world frame (table at z = 0, z up, the rope around the
    origin), of the point between the fingertips that lies on a held rope's centre line. Yaw, joints
    and the avoidance of collisions are left to the implementation.

    Methods block until they are done; an exception ends the execution after a `release()`. Two more
    methods are optional, see `RobotWrapper.expect` and `RobotWrapper.open_to`.
    """

    def observe(self) -> RgbdImage:
        """The camera's newest image, with the time at which it was taken.

        Raises:
            TimeoutError: there is none; it is asked for again.
        """

    def move_to(self, position: NDArray, seconds: float) -> None:
        """Move the gripper in a straight line to a position, to arrive after that time.

        Called every 0.1 s with the next short move; an implementation may blend moves.
        """

    def grasp(self) -> None:
        """Close the fingers where the gripper is. They may close on nothing."""

    def release(self) -> None:
        """Open the fingers. Does nothing when they are open."""

    @property
    def position(self) -> NDArray:
        """(3,) the gripper's measured position."""


class RobotError(RuntimeError):
    """A robot that is not where it was sent, or does not know where it is, or whose images are not
    of its camera."""


class RobotWrapper:
    """A robot that passes all commands on to another one."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def observe(self) -> RgbdImage:
        return self.robot.observe()

    def move_to(self, position: NDArray, seconds: float) -> None:
        self.robot.move_to(position, seconds)

    def grasp(self) -> None:
        self.robot.grasp()

    def release(self) -> None:
        self.robot.release()

    @property
    def position(self) -> NDArray:
        return self.robot.position

    def expect(self, positions: NDArray, seconds: float, strand: float | None = None) -> bool:
        """Announce the next calls of `move_to`: positions (N, 3), metres, a move of `seconds` each.

        A robot may execute them as one motion, from rest to rest; False if it does not. Its fingers
        are to close across a strand of the direction `strand`, radians about z from x, at the end;
        without one they may turn freely.
        """
        expect = getattr(self.robot, "expect", None)
        return expect is not None and bool(expect(positions, seconds, strand))

    def open_to(self, opening: float) -> None:
        """Say how far apart the open fingers are to be, metres: at once where they are open, else
        from the next `release` on. Wider, they would touch other strands."""
        open_to = getattr(self.robot, "open_to", None)
        if open_to is not None:
            open_to(opening)


class RopeSource(Protocol):
    """Source of the rope's shape while it moves."""

    @property
    def lost(self) -> bool:
        """Whether the track is known to be lost."""

    def points(self, robot: Robot, grasped: bool) -> NDArray:
        """The rope (V, 3), metres, after a move; `grasped` says whether the fingers are closed."""


@dataclass
class TrackedRope:
    """A `RopeSource` by `perception.Tracker`: closing fingers take the nearest link."""

    tracker: Tracker
    lost: bool = field(default=False, init=False)
    _grasped_link: int | None = field(default=None, init=False)

    def points(self, robot: Robot, grasped: bool) -> NDArray:
        points, gripper = self.tracker.points, robot.position
        if not grasped:
            self._grasped_link = None
        elif self._grasped_link is None:
            centres = (points[1:] + points[:-1]) / 2
            self._grasped_link = int(np.linalg.norm(centres - gripper, axis=1).argmin())
        try:
            image = robot.observe()
        except TimeoutError:
            return points
        estimate = self.tracker.update(image, gripper, self._grasped_link)
        self.lost = estimate.coverage_fraction < self.tracker.config.lost
        return estimate.points


@dataclass(frozen=True, eq=False)
class Observation:
    """An estimate of a rope at rest."""

    points: NDArray | None  # (V, 3) metres; None where no rope was seen
    state: TopologicalState | None  # None where it cannot be read
    ambiguities: tuple[str, ...] = ()  # why the state may be another one, in words
    ambiguous_ends: tuple[int, ...] = ()  # see `perception.RopeEstimate`

    @classmethod
    def of(
        cls,
        points: NDArray,
        ambiguities: tuple[str, ...] = (),
        ambiguous_ends: tuple[int, ...] = (),
    ) -> Observation:
        state = state_or_none(points)
        if state is None:
            ambiguities += ("the shape's projection does not determine its state",)
        return cls(points, state, tuple(dict.fromkeys(ambiguities)), ambiguous_ends)

    @property
    def all_ambiguities(self) -> tuple[str, ...]:
        """Those of the ends too."""
        from knotflow.perception import END_AMBIGUITIES

        return self.ambiguities + tuple(END_AMBIGUITIES[end] for end in self.ambiguous_ends)


class StateEstimator(Protocol):
    """Reads the rope's state between two actions, when the gripper is out of the way."""

    def estimate(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Observation | None:
        """What is seen now; None while there is no new image.

        `likely` are expected shapes (V, 3), metres, the last seen or tracked one first.
        """


@dataclass
class ImageStateEstimator:
    """A `StateEstimator` by `perception.estimate`; a wider search follows an ambiguous image.

    The first image, which may show the gripper, only tells the camera's time; a later one is read.
    """

    camera: Camera  # at its nominal pose
    rope: RopeConfig = field(default_factory=RopeConfig)
    network: StrandNetwork | None = None  # proposes first guesses; the shipped one by default
    tracker: Tracker | None = None  # restarted from each estimate
    _previous_time: float | None = field(default=None, init=False)
    _search_wider: bool = field(default=False, init=False)

    def estimate(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Observation | None:
        from knotflow.perception import EstimateConfig, ImageError, TraceError, estimate
        from knotflow.perception.camera.table import SeenTable

        try:
            image = robot.observe()
        except TimeoutError:
            self._previous_time = None  # the next image may be of the next look
            return None
        if self._previous_time is None or image.time <= self._previous_time:
            self._previous_time = image.time
            return None
        self._previous_time = None
        try:
            image.check(self.camera)
        except ImageError as error:
            raise RobotError(str(error)) from error
        table = SeenTable.of(image.depth, self.camera)
        if not table.fits:
            wrong = f"the table lies {table}: the camera's pose is wrong"
            return Observation(None, None, (f"{wrong} (`knotflow see` says what fits)",))
        camera = table.seated(self.camera)
        likely = [
            one if len(one) == self.rope.num_vertices else resample(one, self.rope)
            for one in likely
        ]
        config = EstimateConfig() if self._search_wider else EstimateConfig(fallback_search=None)
        rope, net = self.rope, self.network
        first = likely[0] if likely else None
        try:
            found = estimate(
                image, camera, rope, config=config, earlier=first, network=net, likely=likely
            )
        except TraceError as error:
            return Observation(None, None, (str(error),))
        self._search_wider = bool(found.ambiguities) and not self._search_wider
        if self.tracker is not None:
            self.tracker.restart(found, image.time)
        unknown = () if found.head_known else ("head and tail look alike",)
        points, ambiguities = resample(found.points, self.rope), found.ambiguities + unknown
        return Observation.of(points, ambiguities, found.ambiguous_ends)


class CameraTimer(RobotWrapper):
    """Adds up the `seconds` that images took."""

    seconds = 0.0

    def observe(self) -> RgbdImage:
        began = time.perf_counter()
        try:
            return super().observe()
        finally:
            self.seconds += time.perf_counter() - began


class FaultyRobot(RobotWrapper):
    """Fails once, for `duration` seconds, `delay` seconds of moves after the first grasp."""

    delay = 1.0
    duration = 1.0

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._remaining = np.inf  # seconds until it fails

    def move_to(self, position: NDArray, seconds: float) -> None:
        super().move_to(position, seconds)
        self._remaining -= seconds

    def grasp(self) -> None:
        super().grasp()
        self._remaining = min(self._remaining, self.delay)

    @property
    def failing(self) -> bool:
        return -self.duration < round(self._remaining, 6) <= 0


class FramesLost(FaultyRobot):
    """No image arrives for a second of the first drag."""

    def observe(self) -> RgbdImage:
        if self.failing:
            raise TimeoutError("the frame was lost")
        return super().observe()


class RopeOccluded(FaultyRobot):
    """Images show the table alone, from within the first drag until after the first estimate."""

    duration = 8.0

    def observe(self) -> RgbdImage:
        from knotflow.perception import RgbdImage

        image = super().observe()
        if not self.failing:
            return image
        depth = np.where(np.isnan(image.depth), np.nan, np.nanmedian(image.depth))
        colour = np.median(image.rgb.reshape(-1, 3), axis=0).astype(np.uint8)
        rgb = np.broadcast_to(colour, image.rgb.shape)
        return RgbdImage(rgb, depth.astype(np.float32), image.time)


class RopeDropped(FaultyRobot):
    """The fingers open by themselves in the middle of the first drag."""

    def move_to(self, position: NDArray, seconds: float) -> None:
        worked = not self.failing
        super().move_to(position, seconds)
        if worked and self.failing:
            self.robot.release()


FAULTS: dict[str, type[RobotWrapper]] = {
    "": RobotWrapper,
    "frames lost": FramesLost,
    "rope dropped": RopeDropped,
    "table alone": RopeOccluded,
}
"""By the names that tables give them."""

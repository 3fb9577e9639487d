"""What a robot must do to execute a plan: five methods, for a lab to implement; and its faults."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from knotflow.perception import RgbdImage


class Robot(Protocol):
    """A gripper above a table, and a camera that sees both.

    Positions are (3,) in metres in the world frame (table at z = 0, z up, the rope around the
    origin), of the point between the fingertips that lies on a held rope's centre line. Yaw across
    the strand, joints and the avoidance of collisions are left to the implementation.

    Every method blocks until it is done. A command that cannot be carried out raises; any exception
    ends the execution after a `release()`.
    """

    def observe(self) -> RgbdImage:
        """The camera's newest image, with the time at which it was taken.

        Raises:
            TimeoutError: there is none; it is asked for again.
        """
        ...

    def move_to(self, position: NDArray, seconds: float) -> None:
        """Move the gripper in a straight line to a position, to arrive after that time.

        Called every 0.1 s with the next short move; an implementation may blend moves.
        """
        ...

    def grasp(self) -> None:
        """Close the fingers where the gripper is. They may close on nothing."""
        ...

    def release(self) -> None:
        """Open the fingers. Does nothing when they are open."""
        ...

    @property
    def position(self) -> NDArray:
        """(3,) the gripper's measured position."""
        ...


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


class CameraTimer(RobotWrapper):
    """Sums up the `seconds` that images took."""

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
        """Whether it fails now."""
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

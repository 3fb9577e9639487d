"""What a robot must be able to do to execute a plan: five words, for a lab to implement."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

from numpy.typing import NDArray

if TYPE_CHECKING:
    from knotflow.perception import RgbdImage


class Robot(Protocol):
    """A gripper above a table, and a camera that sees both.

    Positions are (3,) in metres in the world frame, in which the table is z = 0, z points up and
    the rope lies around the origin. They are of the point between the fingertips that is on the
    rope's centre line when the gripper holds it. Nothing else of the hand is commanded: yaw across
    the strand, joints and the avoidance of collisions are the implementation's business.

    Every method returns when it is done, so the caller's clock is the robot's. A command that
    cannot be carried out (out of reach, stopped by the hardware) raises; an exception of any kind
    ends the execution after a `release()`.
    """

    def observe(self) -> RgbdImage:
        """The newest image of the camera, with the time at which it was taken.

        Raises:
            TimeoutError: there is none; it is asked for again.
        """
        ...

    def move_to(self, position: NDArray, seconds: float) -> None:
        """Move the gripper in a straight line to a position, to arrive after that time.

        Called every 0.1 s with the next short move while the rope is dragged, so an implementation
        that streams set points blends one move into the next. The fingers stay as they are.
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
        """(3,) where the gripper is, as the robot measures it."""
        ...


class Relay:
    """A robot that passes the five words on to another; its kinds do something besides."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def observe(self) -> RgbdImage:
        """See `Robot`."""
        return self.robot.observe()

    def move_to(self, position: NDArray, seconds: float) -> None:
        """See `Robot`."""
        self.robot.move_to(position, seconds)

    def grasp(self) -> None:
        """See `Robot`."""
        self.robot.grasp()

    def release(self) -> None:
        """See `Robot`."""
        self.robot.release()

    @property
    def position(self) -> NDArray:
        """See `Robot`."""
        return self.robot.position


class Timed(Relay):
    """A robot whose camera is timed: what a simulated image takes is the world's time, not that of
    whoever follows the rope in it.

    Attributes:
        seconds: what all images took so far.
    """

    seconds = 0.0

    def observe(self) -> RgbdImage:
        """See `Robot`."""
        began = time.perf_counter()
        try:
            return super().observe()
        finally:
            self.seconds += time.perf_counter() - began

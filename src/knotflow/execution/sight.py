"""Where the rope's shape comes from: move by move while it is dragged, and between two actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.robot import Robot
from knotflow.simulation import RopeConfig, resample, state_or_none
from knotflow.topology import TopologicalState

if TYPE_CHECKING:
    from knotflow.perception import Camera, EstimateConfig, Network, Tracker


class RopeSource(Protocol):
    """Where the state of the rope comes from while it moves."""

    @property
    def lost(self) -> bool:
        """Whether the rope is known not to be where it was followed to."""
        ...

    def points(self, robot: Robot, grasped: bool) -> NDArray:
        """The rope (V, 3), metres, now; asked for after every move that may move it.

        `grasped` says whether the gripper's fingers are closed.
        """
        ...


@dataclass
class Tracked:
    """The rope as `perception.Tracker` follows it in the robot's images, a `RopeSource`.

    The link that closing fingers take is the one nearest to them. Where an image is missing, the
    rope is taken to be where it was.
    """

    tracker: Tracker
    """Began with the rope as it lay."""
    lost: bool = field(default=False, init=False)
    _held: int | None = field(default=None, init=False)

    def points(self, robot: Robot, grasped: bool) -> NDArray:
        """See `RopeSource`."""
        points, gripper = self.tracker.points, robot.position
        if not grasped:
            self._held = None
        elif self._held is None:
            centres = (points[1:] + points[:-1]) / 2
            self._held = int(np.linalg.norm(centres - gripper, axis=1).argmin())
        try:
            image = robot.observe()
        except TimeoutError:
            return points
        found = self.tracker.update(image, gripper, self._held)
        self.lost = found.explained < self.tracker.config.lost
        return found.points


@dataclass(frozen=True, eq=False)
class Sight:
    """A rope at rest, as one look shows it.

    Attributes:
        points: (V, 3) metres, a shape of the rope; None where none was seen.
        state: its topological state; None where it cannot be read.
        doubts: why it may be another one, in words.
        ends: 0 for the head and -1 for the tail, where it may be another one only because that end
            lies at a strand, and it is not seen whether it crosses it.
    """

    points: NDArray | None
    state: TopologicalState | None
    doubts: tuple[str, ...] = ()
    ends: tuple[int, ...] = ()

    @classmethod
    def of(cls, points: NDArray, doubts: tuple[str, ...] = (), ends: tuple[int, ...] = ()) -> Sight:
        """The sight of a shape, in doubt where its projection cannot be read."""
        state = state_or_none(points)
        if state is None:
            doubts += ("the shape's projection does not determine its state",)
        return cls(points, state, tuple(dict.fromkeys(doubts)), ends)

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """All that is in doubt, in words; empty for a sight to rely on."""
        from knotflow.perception import END_DOUBTS

        return self.doubts + tuple(END_DOUBTS[end] for end in self.ends)

    @classmethod
    def nothing(cls, reason: str) -> Sight:
        """No rope was seen."""
        return cls(None, None, (reason,))


class Look(Protocol):
    """Reads the rope's state between two actions, when the gripper is out of the way."""

    def look(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Sight | None:
        """What is seen now, or None to be asked again a tick later: there is no new image yet.

        Args:
            robot: whose camera sees the rope.
            likely: shapes (V, 3) that it may have, metres: where it was seen or tracked last comes
                first, then where an action should have brought it.
        """
        ...


@dataclass
class Estimated:
    """A `Look` at the robot's images, by `perception.estimate`.

    The image alone is ambiguous where strands touch, and what is likely may not have come about. So
    the estimate begins at the likely shapes, at the paths through the image and at the network's
    guess, and takes the fit that accounts best for the image; where fits of different crossings
    account for it alike, it is in doubt. Head and tail of a plain rope are distinguished by its
    last known shape.

    The first image only shows how late it is by the camera's clock: where frames are lost it may
    have been taken before the gripper was out of the way. A later one is read.
    """

    camera: Camera
    """Where the camera is believed to be."""
    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope that is looked for."""
    config: EstimateConfig | None = None
    """How it is estimated. A wider search, which takes half a minute, is made after a doubt only:
    the next image may show what this one did not."""
    network: Network | None = None
    """Proposes further first guesses; the shipped one where none is given."""
    tracker: Tracker | None = None
    """Goes on from what is seen."""
    _before: float | None = field(default=None, init=False)
    _doubted: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        """Take the default configuration."""
        from knotflow.perception import EstimateConfig

        self.config = self.config or EstimateConfig()

    def look(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Sight | None:
        """See `Look`."""
        from knotflow.perception import TraceError, estimate

        try:
            image = robot.observe()
        except TimeoutError:
            return None
        if self._before is None or image.time <= self._before:
            self._before = image.time
            return None
        self._before = None
        try:
            found = estimate(
                image,
                self.camera,
                self.rope,
                config=self._config(),
                earlier=likely[0] if likely else None,
                network=self.network,
                likely=likely,
            )
        except TraceError as error:
            return Sight.nothing(str(error))
        self._doubted = bool(found.doubts) and not self._doubted
        if self.tracker is not None:
            self.tracker.reseat(found, image.time)
        unknown = () if found.head_known else ("head and tail look alike",)
        return Sight.of(resample(found.points, self.rope), found.doubts + unknown, found.ends)

    def _config(self) -> EstimateConfig:
        """For the next look."""
        assert self.config is not None
        return self.config if self._doubted else replace(self.config, wider=None)

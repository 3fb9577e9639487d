"""Where the rope's shape comes from: move by move while it is dragged, and between two actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.control.robot import Robot
from knotflow.simulation import RopeConfig, resample, state_or_none
from knotflow.topology import TopologicalState

if TYPE_CHECKING:
    from knotflow.perception import Camera, EstimateConfig, Network, Tracker


class RopeSource(Protocol):
    """Where the state of the rope comes from while it moves."""

    @property
    def lost(self) -> bool:
        """Whether the rope is known not to be where it was tracked."""
        ...

    def points(self, robot: Robot, grasped: bool) -> NDArray:
        """The rope (V, 3), metres, now; asked for after every move that may move it.

        `grasped` says whether the gripper's fingers are closed.
        """
        ...


@dataclass
class TrackedRope:
    """The rope as `perception.Tracker` tracks it in the robot's images, a `RopeSource`.

    Closing fingers take the link nearest to them. A missing image leaves the rope where it was.
    """

    tracker: Tracker
    """Began with the rope as it lay."""
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
    """A rope at rest, as one estimate has it.

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
    def of(
        cls, points: NDArray, doubts: tuple[str, ...] = (), ends: tuple[int, ...] = ()
    ) -> Observation:
        """Of a shape (V, 3), ambiguous where its projection cannot be read."""
        state = state_or_none(points)
        if state is None:
            doubts += ("the shape's projection does not determine its state",)
        return cls(points, state, tuple(dict.fromkeys(doubts)), ends)

    @classmethod
    def no_rope(cls, reason: str) -> Observation:
        """No rope was seen."""
        return cls(None, None, (reason,))

    @property
    def all_doubts(self) -> tuple[str, ...]:
        """All that is ambiguous, the ends included, in words."""
        from knotflow.perception import END_AMBIGUITIES

        return self.doubts + tuple(END_AMBIGUITIES[end] for end in self.ends)


class StateEstimator(Protocol):
    """Reads the rope's state between two actions, when the gripper is out of the way."""

    def estimate(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Observation | None:
        """What is seen now, or None to be asked again a tick later: there is no new image yet.

        Args:
            robot: whose camera sees the rope.
            likely: shapes (V, 3) that it may have, metres: where it was seen or tracked last comes
                first, then where an action should have brought it.
        """
        ...


@dataclass
class ImageStateEstimator:
    """A `StateEstimator` by `perception.estimate`.

    The image alone is ambiguous where strands touch, so the fit begins at the likely shapes, at the
    paths through the image and at the network's guess; where fits of different crossings account
    for it alike, it is in doubt. Head and tail of a plain rope are told apart by its last shape.

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
    _previous_time: float | None = field(default=None, init=False)
    _search_wider: bool = field(default=False, init=False)

    def estimate(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Observation | None:
        from knotflow.perception import EstimateConfig, TraceError, estimate

        try:
            image = robot.observe()
        except TimeoutError:
            return None
        if self._previous_time is None or image.time <= self._previous_time:
            self._previous_time = image.time
            return None
        self._previous_time = None
        config = self.config or EstimateConfig()
        try:
            found = estimate(
                image,
                self.camera,
                self.rope,
                config=config if self._search_wider else replace(config, fallback_search=None),
                earlier=likely[0] if likely else None,
                network=self.network,
                likely=likely,
            )
        except TraceError as error:
            return Observation.no_rope(str(error))
        self._search_wider = bool(found.ambiguities) and not self._search_wider
        if self.tracker is not None:
            self.tracker.restart(found, image.time)
        unknown = () if found.head_known else ("head and tail look alike",)
        return Observation.of(
            resample(found.points, self.rope), found.ambiguities + unknown, found.ambiguous_ends
        )

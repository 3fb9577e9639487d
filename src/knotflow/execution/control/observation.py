"""Sources of the rope's state: while it is dragged, and between two actions."""

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
    """Source of the rope's shape while it moves."""

    @property
    def lost(self) -> bool:
        """Whether the track is known to be lost."""
        ...

    def points(self, robot: Robot, grasped: bool) -> NDArray:
        """The rope (V, 3), metres, after a move; `grasped` says whether the fingers are closed."""
        ...


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
    """An estimate of a rope at rest.

    Attributes:
        points: (V, 3) metres; None where no rope was seen.
        state: its topological state; None where it cannot be read.
        doubts: why the state is ambiguous, in words.
        ends: 0 for the head and -1 for the tail, where it is ambiguous only whether that end
            crosses the strand at which it lies.
    """

    points: NDArray | None
    state: TopologicalState | None
    doubts: tuple[str, ...] = ()
    ends: tuple[int, ...] = ()

    @classmethod
    def of(
        cls, points: NDArray, doubts: tuple[str, ...] = (), ends: tuple[int, ...] = ()
    ) -> Observation:
        """Of a shape (V, 3)."""
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
        """`doubts` and `ends`, in words."""
        from knotflow.perception import END_AMBIGUITIES

        return self.doubts + tuple(END_AMBIGUITIES[end] for end in self.ends)


class StateEstimator(Protocol):
    """Reads the rope's state between two actions, when the gripper is out of the way."""

    def estimate(self, robot: Robot, likely: Sequence[NDArray] = ()) -> Observation | None:
        """What is seen now; None while there is no new image.

        Args:
            robot: whose camera sees the rope.
            likely: expected shapes (V, 3), metres; the last seen or tracked one first.
        """
        ...


@dataclass
class ImageStateEstimator:
    """A `StateEstimator` by `perception.estimate`.

    The first image, which may show the gripper, only tells the camera's time; a later one is read.
    """

    camera: Camera
    """At its nominal pose."""
    rope: RopeConfig = field(default_factory=RopeConfig)
    config: EstimateConfig | None = None
    """Its slow wider search is used only after an ambiguous image."""
    network: Network | None = None
    """Proposes further first guesses; the shipped one by default."""
    tracker: Tracker | None = None
    """Restarted from each estimate."""
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

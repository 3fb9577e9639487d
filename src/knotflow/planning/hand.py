"""What a search has to know of the arm and the hand that execute its plans."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.fingers import HandConfig, openings
from knotflow.planning.plan import KnotPlan
from knotflow.simulation import grasped_link
from knotflow.topology.polyline import Floats


class Reach(Protocol):
    """An arm's reach, in the frame of the searched rope; see `execution.ArmReach`."""

    def may_follow(self, points: Floats, splines: Floats) -> NDArray[np.bool_]:
        """Which of splines (N, 6) on a rope (V, 3), metres, the arm can likely follow: (N,)."""
        ...

    def first_failed(self, plan: KnotPlan) -> int | None:
        """The first step that the arm cannot follow or that fails by it, None without any."""
        ...


@dataclass(frozen=True)
class Hand:
    """A `Reach` of fingers, and of the arm that carries them, if any."""

    radius: float
    """Of the rope, metres."""
    config: HandConfig = field(default_factory=HandConfig)
    arm: Reach | None = None

    @property
    def catches(self) -> float:
        """Largest distance of a centre line from between the fingers that they catch, metres."""
        return self.config.opening / 2

    def may_follow(self, points: Floats, splines: Floats) -> NDArray[np.bool_]:
        links = grasped_link(splines, len(points) - 1)
        fits = openings(points, links, self.radius, self.config) > 0
        return fits if self.arm is None else fits & self.arm.may_follow(points, splines)

    def first_failed(self, plan: KnotPlan) -> int | None:
        return None if self.arm is None else self.arm.first_failed(plan)

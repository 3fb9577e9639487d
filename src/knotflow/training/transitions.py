"""Transitions: what a batch of splines of one action made of its ropes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation import Attempts
from knotflow.topology import Action, TopologicalState


@dataclass(frozen=True)
class Transitions:
    """N attempts at one action from one topological state, and where they led."""

    action: Action
    """The action that was tried."""
    start: TopologicalState
    """The state of every rope before."""
    points: NDArray[np.float64]
    """(N, V, 3) start shapes, metres."""
    splines: NDArray[np.float64]
    """(N, 6), see `simulation.spline`."""
    success: NDArray[np.bool_]
    """(N,) whether the action's state was reached."""
    ends: NDArray[np.float64]
    """(N, V, 3) end shapes, metres; where the action failed they are not looked at."""

    def __len__(self) -> int:
        return len(self.splines)

    @classmethod
    def of(cls, attempts: Attempts) -> Transitions:
        """The transitions of a batch of attempts."""
        return cls(
            attempts.action,
            attempts.start,
            attempts.points,
            attempts.splines,
            attempts.success,
            attempts.rollouts.end_points,
        )

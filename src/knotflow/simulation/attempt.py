"""An attempt: splines executed to instantiate a topological action, and the states they reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation.simulator import Rollouts, RopeSimulator
from knotflow.topology import Action, DegenerateCurveError, TopologicalState


@dataclass(frozen=True)
class Attempts:
    """A batch of attempts at one action from one topological state."""

    action: Action
    """What they are for; an `Arrange` succeeds where the state is kept."""
    start: TopologicalState
    """The state of every rope before."""
    points: NDArray[np.float64]
    """(B, V, 3) start shapes, metres."""
    splines: NDArray[np.float64]
    """(B, 6) splines."""
    rollouts: Rollouts
    """What the simulator made of them."""
    ends: tuple[TopologicalState | None, ...]
    """(B,) states at rest; None where the projection cannot be read or the simulation diverged."""

    @classmethod
    def of(
        cls,
        action: Action,
        start: TopologicalState,
        points: NDArray,
        splines: NDArray,
        rollouts: Rollouts,
    ) -> Attempts:
        """Attempts whose end states are read from their rollouts."""
        return cls(action, start, points, splines, rollouts, end_states(rollouts))

    @property
    def goal(self) -> TopologicalState:
        """The state the action leads to."""
        return self.start.apply(self.action)

    @property
    def success(self) -> NDArray[np.bool_]:
        """(B,) whether the rope at rest has exactly the state the action leads to."""
        goal = self.goal
        return np.array([end == goal for end in self.ends], dtype=bool)

    def __len__(self) -> int:
        return len(self.splines)


Observer = Callable[[Attempts], None]
"""Called with every batch of attempts, by whatever simulates some: for recording and progress."""


def attempt(
    simulator: RopeSimulator,
    points: NDArray,
    splines: NDArray,
    action: Action,
    start: TopologicalState,
    observe: Observer | None = None,
) -> Attempts:
    """Execute splines (B, 6) on ropes (B, V, 3) or on one rope (V, 3) and read the states.

    Raises:
        IllegalActionError: if the start state does not allow the action.
        ShapeError, SplineError: see `RopeSimulator.execute`.
    """
    start.apply(action)
    if np.ndim(points) == 2:
        points = np.broadcast_to(points, (len(splines), *np.shape(points)))
    rollouts = simulator.execute(points, splines)
    attempts = Attempts.of(action, start, points, splines, rollouts)
    if observe is not None:
        observe(attempts)
    return attempts


def end_states(rollouts: Rollouts) -> tuple[TopologicalState | None, ...]:
    """(B,) states at rest; None where the projection cannot be read or the simulation diverged."""
    return tuple(
        None if diverged else state_or_none(end)
        for end, diverged in zip(rollouts.end_points, rollouts.diverged, strict=True)
    )


def state_or_none(points: NDArray) -> TopologicalState | None:
    """The state of a rope (V, 3), or None where its projection cannot be read."""
    try:
        return TopologicalState.from_curve(points)
    except DegenerateCurveError:
        return None

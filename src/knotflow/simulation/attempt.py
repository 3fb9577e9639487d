"""Trials: splines tried for a topological action, and the states they reached."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation.rope import check_points
from knotflow.simulation.simulator import Rollouts, RopeSimulator
from knotflow.topology import Action, DegenerateCurveError, TopologicalState, parse_action


@dataclass(frozen=True)
class Trials:
    """N splines tried for one action on ropes in one topological state."""

    action: Action
    """The action to instantiate; an `Arrange` succeeds where the state is kept."""
    start: TopologicalState
    """State of every rope before."""
    points: NDArray[np.float64]
    """(N, V, 3) start shapes, metres."""
    splines: NDArray[np.float64]
    """(N, 6) splines."""
    success: NDArray[np.bool_]
    """(N,) whether the rope at rest has the goal's state."""

    def __len__(self) -> int:
        return len(self.splines)

    def __getitem__(self, rows: NDArray[np.bool_]) -> Trials:
        return Trials(
            self.action, self.start, self.points[rows], self.splines[rows], self.success[rows]
        )

    @property
    def goal(self) -> TopologicalState:
        return self.start.apply(self.action)

    def save(self, path: Path) -> None:
        arrays = {name: getattr(self, name) for name in ("points", "splines", "success")}
        np.savez_compressed(path, action=str(self.action), start=str(self.start), **arrays)

    @staticmethod
    def load(path: Path) -> Trials:
        """Read what `save` wrote; of attempts, their trials."""
        with np.load(path) as file:
            return Trials(
                parse_action(str(file["action"])),
                TopologicalState.parse(str(file["start"])),
                *(file[name] for name in ("points", "splines", "success")),
            )


@dataclass(frozen=True)
class Attempts(Trials):
    """Trials with the simulated motion."""

    rollouts: Rollouts
    ends: tuple[TopologicalState | None, ...]
    """(N,) states at rest; None where the projection cannot be read or the simulation diverged."""

    @classmethod
    def of(
        cls,
        action: Action,
        start: TopologicalState,
        points: NDArray[np.float64],
        splines: NDArray[np.float64],
        rollouts: Rollouts,
        ends: Sequence[TopologicalState | None] | None = None,
    ) -> Attempts:
        """Attempts with the given end states, or those read from the rollouts."""
        ends = tuple(end_states(rollouts) if ends is None else ends)
        goal = start.apply(action)
        success = np.array([end == goal for end in ends], dtype=bool)
        return cls(action, start, points, splines, success, rollouts, ends)


Observer = Callable[[Attempts], None]
"""Called with every batch of attempts, for recording and progress."""


def attempt(
    simulator: RopeSimulator,
    points: NDArray[np.float64],
    splines: NDArray[np.float64],
    action: Action,
    start: TopologicalState,
    observe: Observer | None = None,
) -> Attempts:
    """Execute splines (B, 6) on ropes (B, V, 3) or on one rope (V, 3) and read the states.

    Raises:
        IllegalActionError, ShapeError, SplineError: see `TopologicalState.apply`, `RopeSimulator`.
    """
    start.apply(action)
    points = check_points(points, simulator.config.rope)
    if points.ndim == 2:
        points = np.broadcast_to(points, (len(splines), *points.shape))
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


def state_or_none(points: NDArray[np.float64]) -> TopologicalState | None:
    """The state of a rope (V, 3), or None where its projection cannot be read."""
    try:
        return TopologicalState.from_curve(points)
    except DegenerateCurveError:
        return None

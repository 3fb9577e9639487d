"""Ropes that are being tied, many at a time: all that the environments know of the game.

An episode begins with a rope at rest and follows the solution DAG of its goal. A spline is
executed, the rope comes to rest, and its state is read. In a goal state the episode is won, with a
reward of 1. In a state off the DAG, or one that cannot be read, it is lost, for nothing is ever
undone; so it is where the simulation blew up. In any other state of the DAG, the one before
included, it goes on until its splines are used up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.apps.tasks.task import TieTask
from knotflow.simulation import RopeSimulator, end_states, state_or_none
from knotflow.topology import TopologicalState


@dataclass(frozen=True)
class StepResult:
    """What one spline each did to B ropes."""

    success: NDArray[np.bool_]
    """(B,) whether the rope is in a goal state."""
    terminated: NDArray[np.bool_]
    """(B,) whether the episode is won or lost."""
    truncated: NDArray[np.bool_]
    """(B,) whether it ended for want of splines, neither won nor lost."""
    diverged: NDArray[np.bool_]
    """(B,) whether the simulation blew up."""


class Episodes:
    """B ropes, an episode of a task each."""

    def __init__(self, task: TieTask, batch: int, simulator: RopeSimulator) -> None:
        self.task = task
        self.simulator = simulator
        self.points = np.zeros((batch, simulator.config.rope.num_vertices, 3))
        """(B, V, 3) the ropes as they lie, metres."""
        self.states: list[TopologicalState | None] = [None] * batch
        """(B,) their states; None where one cannot be read."""
        self.used = np.zeros(batch, np.intp)
        """(B,) splines executed in this episode."""

    def __len__(self) -> int:
        return len(self.points)

    def reset(self, row: int, rng: np.random.Generator, index: int | None = None) -> None:
        """Begin an episode with a start of the task; see `TieTask.start`."""
        self.points[row] = self.task.start(rng, self.simulator.config.rope, index)
        self.states[row] = state_or_none(self.points[row])
        self.used[row] = 0

    def step(self, splines: NDArray) -> StepResult:
        """Execute splines (B, 6), one on each rope.

        Raises:
            SplineError: for splines out of range.
        """
        rollouts = self.simulator.execute(self.points, splines)
        self.points = rollouts.end_points
        self.states = list(end_states(rollouts))
        self.used = self.used + 1
        goal = self.task.goal
        success = np.array([state in goal.states for state in self.states], bool)
        lost = np.array([state is None or state not in goal.dag for state in self.states], bool)
        terminated = success | lost
        used_up = (self.used >= self.task.splines) & ~terminated
        return StepResult(success, terminated, used_up, rollouts.diverged)

"""An attempt at an action by several splines: arranging ones, then one that acts (Sec. VIII)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.nodes import Simulator
from knotflow.samplers.sampler import Sampler, capability
from knotflow.simulation import Attempts, Observer
from knotflow.topology import Action, Arrange, TopologicalState

Floats = NDArray[np.float64]

MIN_GAIN = 0.05
"""A rope is arranged where the critic predicts at least so much more value after it."""


@dataclass(frozen=True)
class ArrangedAttempts:
    """A batch of attempts at one action from one topological state."""

    success: NDArray[np.bool_]
    """(B,) whether the rope at rest has exactly the state that the action leads to."""
    splines: NDArray[np.intp]
    """(B,) number of splines executed, arranging ones included."""


def attempt_arranged(
    points: Floats,
    action: Action,
    start: TopologicalState,
    sampler: Sampler,
    simulator: Simulator,
    rng: np.random.Generator,
    most: int = 3,
    observe: Observer | None = None,
) -> ArrangedAttempts:
    """Try an action on ropes (B, V, 3), arranging each before by up to `most` splines.

    An arranging spline that loses the state ends the attempt. A sampler that cannot arrange, or
    value the gain, acts at once.

    The ropes are in metres, at rest, all in the state `start`.

    Raises:
        IllegalActionError: the start state does not allow the action.
    """
    arrange = capability(sampler, "arrange")
    values, arranged_values = capability(sampler, "values"), capability(sampler, "arranged_values")
    start.apply(action)
    points = np.array(points, dtype=np.float64)
    used = np.zeros(len(points), np.intp)
    success = np.ones(len(points), bool)  # of the latest spline
    rows = np.arange(len(points))

    def execute(rows: NDArray[np.intp], splines: Floats, attempted: Action) -> None:
        rollouts = simulator.execute(points[rows], splines)
        attempts = Attempts.of(attempted, start, points[rows], splines, rollouts)
        points[rows], success[rows] = rollouts.end_points, attempts.success
        used[rows] += 1
        if observe is not None:
            observe(attempts)

    for _ in range(most):
        if arrange is None or values is None or arranged_values is None or not len(rows):
            break
        actions = [action] * len(rows)
        gain = arranged_values(points[rows], actions, rng) - values(points[rows], actions, rng)
        rows = rows[gain >= MIN_GAIN]
        if len(rows):
            splines = np.concatenate([arrange(points[row], action, 1, rng) for row in rows])
            execute(rows, splines, Arrange(action))
            rows = rows[success[rows]]
    rows = np.flatnonzero(success)
    if len(rows):
        splines = np.concatenate([sampler.sample(points[row], action, 1, rng) for row in rows])
        execute(rows, splines, action)
    return ArrangedAttempts(success, used)

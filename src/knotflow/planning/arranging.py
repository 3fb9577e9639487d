"""An attempt at an action by several splines: such that arrange the rope, then one that acts.

The paper names more than one spline for an action as future work (Sec. VIII). The splines of an
attempt follow each other on one rope, as a robot would execute them: an arranging one that loses
the state ends the attempt. `tree` instead grows many such attempts and keeps the best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import Simulator
from knotflow.samplers.sampler import Sampler, ability
from knotflow.simulation import Attempts, Observer
from knotflow.topology import Action, Arrange, TopologicalState

LEAST_GAIN = 0.05
"""A rope is arranged where the critic promises at least so much more value after it."""


@dataclass(frozen=True)
class ArrangedAttempts:
    """A batch of attempts at one action from one topological state."""

    success: NDArray[np.bool_]
    """(B,) whether the rope at rest has exactly the state that the action leads to."""
    splines: NDArray[np.intp]
    """(B,) number of splines executed, arranging ones included."""


def attempt_arranged(
    points: NDArray,
    action: Action,
    start: TopologicalState,
    sampler: Sampler,
    simulator: Simulator,
    rng: np.random.Generator,
    most: int = 3,
    observe: Observer | None = None,
) -> ArrangedAttempts:
    """Try an action on ropes (B, V, 3), arranging each before by up to `most` splines.

    Args:
        points: (B, V, 3) metres, at rest in the state `start`.
        action: legal in it.
        start: the state of every rope.
        sampler: one that may arrange, see `samplers.Arranger`.
        simulator: executes the splines.
        rng: everything random comes from it.
        most: arranging splines before the one that acts.
        observe: is shown every batch of splines.

    A sampler that cannot arrange, or value what it would gain, acts at once.

    Raises:
        IllegalActionError: the start state does not allow the action.
    """
    arrange = ability(sampler, "arrange")
    values, arranged_values = ability(sampler, "values"), ability(sampler, "arranged_values")
    start.apply(action)
    points = np.array(points, dtype=np.float64)
    used = np.zeros(len(points), np.intp)
    alive = np.ones(len(points), bool)
    open_ = np.arange(len(points))

    def execute(rows: NDArray, splines: NDArray, meant: Action) -> NDArray[np.bool_]:
        rollouts = simulator.execute(points[rows], splines)
        tried = Attempts.of(meant, start, points[rows], splines, rollouts)
        points[rows], used[rows] = rollouts.end_points, used[rows] + 1
        if observe is not None:
            observe(tried)
        return tried.success

    for _ in range(most):
        if arrange is None or values is None or arranged_values is None or not len(open_):
            break
        actions = [action] * len(open_)
        gain = arranged_values(points[open_], actions, rng) - values(points[open_], actions, rng)
        open_ = open_[gain >= LEAST_GAIN]
        if not len(open_):
            break
        splines = np.concatenate([arrange(points[row], action, 1, rng) for row in open_])
        alive[open_] = execute(open_, splines, Arrange(action))
        open_ = open_[alive[open_]]
    rows = np.flatnonzero(alive)
    success = np.zeros(len(points), bool)
    if len(rows):
        splines = np.concatenate([sampler.sample(points[row], action, 1, rng) for row in rows])
        success[rows] = execute(rows, splines, action)
    return ArrangedAttempts(success, used)

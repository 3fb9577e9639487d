"""Clearance: how much room the end of a demonstration leaves for the actions that follow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotflow.samplers.demonstrations.dataset import TASKS, Task
from knotflow.samplers.demonstrations.heuristic import heuristic_splines
from knotflow.simulation import Observer, RopeConfig, RopeSimulator, attempt
from knotflow.topology import Action, Cross, TopologicalState, segment_lengths
from knotflow.topology.polyline import Floats

MOST_ACTIONS = 2
"""Actions drawn where no task begins in the reached state."""


def next_actions(task: Task, rng: np.random.Generator) -> tuple[Action, ...]:
    """The actions of `TASKS` from the state a task reaches; without any, random legal Crosses."""
    state = task.goal_state
    if known := tuple(one.action for one in TASKS if one.start_state == state):
        return known
    legal = [action for action, _ in state.actions() if isinstance(action, Cross)]
    drawn = rng.choice(len(legal), min(MOST_ACTIONS, len(legal)), replace=False)
    return tuple(legal[i] for i in drawn)


def loop_size(points: Floats, rope: RopeConfig) -> float:
    """Length of the shortest loop of a rope (V, 3), metres; needs no simulation.

    A loop is a segment between neighbouring crossings. An end counts twice: it is led through once,
    where a loop's strand goes there and back.
    """
    lengths = segment_lengths(points) * rope.length
    lengths[[0, -1]] *= 2
    return float(lengths.min())


def clearance(
    ends: Floats,
    state: TopologicalState,
    actions: Sequence[Action],
    trials: int,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    observe: Observer | None = None,
) -> float:
    """Success rate of heuristic splines for the next actions, 0 to 1.

    The geometric mean over the actions of Laplace's (successes + 1) / (trials + 2).

    Args:
        ends: (E, V, 3) ropes in `state`, metres; trials are shared out among them.
        state: that allows the actions.
        actions: at least one.
        trials: splines an action.
        simulator: executes them.
        rng: everything random comes from it.
        observe: is shown every attempt.
    """
    ropes = ends[np.arange(trials) % len(ends)]
    shares = []
    for action in actions:
        splines = np.concatenate([heuristic_splines(points, action, 1, rng) for points in ropes])
        successes = attempt(simulator, ropes, splines, action, state, observe).success.sum()
        shares.append((successes + 1) / (trials + 2))
    return float(np.exp(np.mean(np.log(shares))))

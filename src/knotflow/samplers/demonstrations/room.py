"""Room: what the end of a demonstration leaves for the actions that follow.

A person who demonstrates a loop leaves one that the rope's end can be led through. A spline that
succeeds and leaves a tight loop, or a stub of an end, is a step into a dead end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations.aim import aim
from knotflow.samplers.demonstrations.tasks import TASKS, Task
from knotflow.simulation import Observer, RopeConfig, RopeSimulator, attempt
from knotflow.topology import Action, Cross, TopologicalState, segment_lengths

MOST_ACTIONS = 2
"""Actions drawn where no task begins in the reached state."""


def next_actions(task: Task, rng: np.random.Generator) -> tuple[Action, ...]:
    """The actions that may follow a task: those of `TASKS` from the state it reaches.

    Where there are none, a few of the legal Cross actions are drawn; after the first loop, knots
    are tied by those.
    """
    state = task.goal_state
    if known := tuple(one.action for one in TASKS if one.start_state == state):
        return known
    legal = [action for action, _ in state.actions() if isinstance(action, Cross)]
    drawn = rng.choice(len(legal), min(MOST_ACTIONS, len(legal)), replace=False)
    return tuple(legal[i] for i in drawn)


def loop_size(points: NDArray, rope: RopeConfig) -> float:
    """How long the shortest loop of a rope (V, 3) is, metres: a measure without a simulation.

    A loop is a segment between neighbouring crossings; an end counts twice, for it is led through
    once and a loop's strand goes there and back. It says a little: over 216 guesses at what follows
    R1 from the straight rope its correlation with success was 0.10 (0.19 for C(0,1,1), 0.27 for
    C(1,2,1)), that of the shortest segment -0.03.
    """
    lengths = segment_lengths(points) * rope.length
    lengths[[0, -1]] *= 2
    return float(lengths.min())


def room(
    ends: NDArray,
    state: TopologicalState,
    actions: Sequence[Action],
    guesses: int,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    observe: Observer | None = None,
) -> float:
    """How often the demonstrator's first guess at what follows succeeds, 0 to 1.

    The share of aimed guesses at each action, as a geometric mean over the actions: room for one
    does not make up for none for another. Shares are those of Laplace's rule of succession,
    (successes + 1) / (guesses + 2), so a few failures leave a number that can still be compared.

    Args:
        ends: (E, V, 3) ropes in `state`, metres; guesses are shared out among them.
        state: that allows the actions.
        actions: at least one.
        guesses: aimed splines an action.
        simulator: executes them.
        rng: everything random comes from it.
        observe: is shown every attempt.
    """
    ropes = ends[np.arange(guesses) % len(ends)]
    shares = []
    for action in actions:
        splines = np.concatenate([aim(points, action, 1, rng) for points in ropes])
        hits = attempt(simulator, ropes, splines, action, state, observe).success.sum()
        shares.append((hits + 1) / (guesses + 2))
    return float(np.exp(np.mean(np.log(shares))))

"""End shapes known to be reachable from given starts (Sec. VII-C).

"Causal InfoGAN requires the end configuration to be given, and we guarantee there is a feasible
path." The guarantee is a rollout: aimed guesses, a proposal of neither side of the comparison, are
executed from each start until one reaches the goal state, and the rope at rest is the end shape.
Starts without one are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import TASKS, aim, task
from knotflow.simulation import Attempts, Observer, RopeSimulator, attempt
from knotflow.topology import Action, TopologicalState, segment_lengths

FOCUS = "C(0,1,1)"
OVERHAND = "overhand"
_LAST = task("C(2,0,1)")


@dataclass(frozen=True)
class ActionSequence:
    """A start state and the actions to execute from there."""

    name: str
    """As in the tables: an action, or "overhand"."""
    first: str
    """The action whose unseen starts are taken."""
    actions: tuple[Action, ...]
    """To be executed one after the other."""

    @property
    def file(self) -> str:
        """The goal as a file name."""
        return task(self.first).name if len(self.actions) == 1 else self.name

    @property
    def start_state(self) -> TopologicalState:
        """The state of the starts."""
        return task(self.first).start_state


GOALS: tuple[ActionSequence, ...] = (
    *(ActionSequence(str(one.action), str(one.action), (one.action,)) for one in TASKS),
    # The overhand of Sec. VII-A4: R1(0,1,1), C(0,1,1), C(2,0,1).
    ActionSequence(OVERHAND, str(_LAST.start_actions[0]), (*_LAST.start_actions, _LAST.action)),
)
"""The eight actions of Fig. 6 and the multi-stage overhand."""

Propose = Callable[[NDArray, Action, TopologicalState], Attempts]
"""Guesses for an action on a rope (V, 3) in a state, executed."""


def guess(
    simulator: RopeSimulator, count: int, rng: np.random.Generator, observe: Observer
) -> Propose:
    """So many aimed guesses at a time."""

    def propose(points: NDArray, action: Action, state: TopologicalState) -> Attempts:
        splines = aim(points, action, count, rng)
        return attempt(simulator, points, splines, action, state, observe)

    return propose


def reachable_end(
    points: NDArray, goal: ActionSequence, propose: Propose, rounds: int
) -> NDArray | None:
    """A rope (V, 3) at rest in the goal's state, reached from a start (V, 3) in metres.

    Args:
        points: the start.
        goal: its actions are executed.
        propose: executes a batch of guesses.
        rounds: batches for each action before the start is given up, and None is returned.
    """
    batches = iter(range(rounds * len(goal.actions)))
    return _reach(points, goal.start_state, goal.actions, propose, batches, rounds)


def _reach(
    points: NDArray,
    state: TopologicalState,
    actions: Sequence[Action],
    propose: Propose,
    batches: Iterator[int],
    rounds: int,
) -> NDArray | None:
    """The rope (V, 3) after the actions, None where the guesses ran out.

    At most `rounds` batches are spent on an action after one success of the action before; another
    success is then sought, as long as there are `batches`.
    """
    if not actions:
        return points
    for _ in islice(batches, rounds):
        tried = propose(points, actions[0], state)
        if tried.success.any():
            best = _roomiest(tried.rollouts.end_points[tried.success])
            after = state.apply(actions[0])
            end = _reach(best, after, actions[1:], propose, batches, rounds)
            if end is not None:
                return end
    return None


def _roomiest(shapes: NDArray) -> NDArray:
    """Of ropes (N, V, 3) the one whose shortest segment is longest: it is easiest to go on from."""
    return max(shapes, key=lambda points: segment_lengths(points).min())

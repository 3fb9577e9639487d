"""What a trial of self-play teaches: of what was meant, and in hindsight of what was done.

- Whether the action succeeded, and of a success the value of what it leaves: the best that the next
  action's critic expects of the end shape, for a next action drawn among all that are legal there.
- Of an arranging spline whether the state was kept, and the value of the wanted action after it; an
  actor is pulled towards those that raised it, and splines that failed at an action without having
  been meant to arrange teach the same.
- Hindsight: a rope that ends in the state of another legal action is a success of that one. So that
  this stays unbiased, trials that could have ended there, but did not, are its failures.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.primitives.canonical import ARRANGE, Canonical, canonicalise
from knotflow.samplers.primitives.encoding import encode_canonical
from knotflow.topology import (
    Action,
    DegenerateCurveError,
    IllegalActionError,
    TopologicalState,
    parse_action,
)
from knotflow.training.config import SelfPlayConfig
from knotflow.training.curriculum import Curriculum, Pair, outcomes

FARTHEST_GRASP = 3.5
"""Trials that grasp the rope farther away from where an action does, network units, teach nothing.
It is half a segment beyond the end of the one that is grasped, or anywhere where all may be."""


@dataclass(frozen=True)
class Trial:
    """A spline on a rope (V, 3), and what came of it."""

    points: NDArray[np.float64]
    state: TopologicalState
    action: Action
    """What it was meant to do, or to make room for."""
    spline: NDArray[np.float64]
    after: NDArray[np.float64]
    end: TopologicalState | None

    @property
    def success(self) -> bool:
        """Whether it ended in the action's state."""
        return self.end == self.state.apply(self.action)


@dataclass
class Lesson:
    """What one trial says of one action; lessons of several actions may be of the same spline."""

    points: NDArray[np.float64]
    action: Action
    spline: NDArray[np.float64]
    reward: float
    after: NDArray[np.float64] | None = None
    following: Action | None = None
    """The action whose value `after` counts; None where nothing follows."""
    arranging: bool = False
    baseline: float = 0.0
    weight: float = 1.0
    pull: float = 1.0


class Lessons:
    """Draws lessons from trials; remembers what came of trials that were meant otherwise."""

    def __init__(
        self, curriculum: Curriculum, config: SelfPlayConfig, rng: np.random.Generator
    ) -> None:
        """Args: what follows on what, how much is learned from what, and everything random."""
        self._curriculum, self._config, self._rng = curriculum, config, rng
        self._done: dict[Pair, Counter[Action]] = {}

    def of(self, trial: Trial, arranging: bool, value: float) -> Iterator[Lesson]:
        """All that a trial teaches.

        Args:
            trial: what came of it.
            arranging: it was meant to make room for the action, not to do it.
            value: of the action before.
        """
        success = trial.success
        if not arranging:
            yield self.at(trial, trial.action, success)
        if not success and (arranging or self._rng.random() < self._config.arranging_share):
            kept = trial.end == trial.state
            yield Lesson(
                trial.points,
                trial.action,
                trial.spline,
                float(kept),
                after=trial.after if kept else None,
                following=trial.action if kept else None,
                arranging=True,
                baseline=value,
            )
        if self._config.hindsight:
            yield from self._in_hindsight(trial, arranging)

    def at(self, trial: Trial, action: Action, success: bool, weight: float = 1.0) -> Lesson:
        """What a trial says of an action that it did or did not accomplish."""
        lesson = Lesson(trial.points, action, trial.spline, float(success), weight=weight)
        if success and trial.end is not None:
            lesson.following = self._curriculum.next_action(trial.end, self._rng)
            lesson.after = trial.after if lesson.following is not None else None
        return lesson

    def _in_hindsight(self, trial: Trial, arranging: bool) -> Iterator[Lesson]:
        """The trial as one of other actions: of the one it accomplished, and of one that other
        trials for the same action accomplished; the latter stands for all such."""
        rng, end = self._rng, trial.end
        reached = outcomes(trial.state, self._config.most_crossings)
        done = [other for other, onward in reached.items() if onward == end]
        if not arranging and trial.action in done:
            done = []
        others = self._done.setdefault((trial.state, trial.action), Counter())
        missed = sorted((other for other in others if reached[other] != end), key=str)
        if done:
            other = done[rng.integers(len(done))]
            others[other] += 1
            yield replace(self.at(trial, other, True), pull=self._config.hindsight_pull)
        if missed:
            other = missed[rng.integers(len(missed))]
            yield self.at(trial, other, False, weight=min(len(missed), 4))

    def state_dict(self) -> dict[str, Any]:
        """What trials did that were meant otherwise."""
        return {
            f"{state} {action}": {str(other): n for other, n in counts.items()}
            for (state, action), counts in self._done.items()
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state_dict`."""
        self._done = {}
        for name, counts in state.items():
            before, action = name.split(" ", 1)
            self._done[TopologicalState.parse(before), parse_action(action)] = Counter(
                {parse_action(other): count for other, count in counts.items()}
            )


def encoded(
    lessons: Sequence[Lesson], value: Callable[[int, TensorDict], Tensor]
) -> Iterator[tuple[int, TensorDict]]:
    """Primitives, and what each learns, as `TransitionBuffer.extend` takes it.

    Args:
        lessons: of any actions.
        value: given a primitive and encoded ropes [N], their values (N,).
    """
    by_number: dict[int, list[tuple[Lesson, Canonical]]] = {}
    for lesson in lessons:
        if (rope := canonical_or_none(lesson.points, lesson.action)) is not None:
            number = ARRANGE if lesson.arranging else rope.primitive
            by_number.setdefault(number, []).append((lesson, rope))
    for number in sorted(by_number):
        own = [lesson for lesson, _ in by_number[number]]
        ropes = encode_canonical([rope for _, rope in by_number[number]], number == ARRANGE)
        splines = ropes.frames.to_network(np.stack([one.spline for one in own])[:, None])[:, 0]
        # In hindsight an action may have been done from anywhere. Counted in short segments,
        # such grasps are thousands of units away: no way to learn to do it.
        rows = np.flatnonzero(np.abs(splines[:, 0]) <= FARTHEST_GRASP)
        if len(rows):
            states = ropes.states[torch.from_numpy(rows)]
            yield number, _transitions(states, splines[rows], [own[row] for row in rows], value)


def _transitions(
    own: TensorDict,
    splines: NDArray,
    lessons: Sequence[Lesson],
    value: Callable[[int, TensorDict], Tensor],
) -> TensorDict:
    """Lessons with encoded ropes [N] and splines (N, 6) in network space."""
    following = own.select("streams", "grasp").apply(torch.zeros_like)
    follower = torch.full((len(lessons),), -1)
    next_value = torch.full((len(lessons),), torch.nan)
    onward: dict[int, list[tuple[int, Canonical]]] = {}
    for row, lesson in enumerate(lessons):
        if lesson.after is None or lesson.following is None:
            continue
        if (rope := canonical_or_none(lesson.after, lesson.following)) is not None:
            onward.setdefault(rope.primitive, []).append((row, rope))
    for number, some in onward.items():
        rows = torch.tensor([row for row, _ in some])
        states = encode_canonical([rope for _, rope in some]).states.select("streams", "grasp")
        following[rows], follower[rows] = states, number
        next_value[rows] = value(number, states)
    return TensorDict(
        {
            "states": own,
            "following": following,
            "follower": follower,
            "spline": torch.from_numpy(splines).float(),
            "reward": torch.tensor([lesson.reward for lesson in lessons]),
            "baseline": torch.tensor([float(lesson.baseline) for lesson in lessons]),
            "weight": torch.tensor([float(lesson.weight) for lesson in lessons]),
            "pull": torch.tensor([float(lesson.pull) for lesson in lessons]),
            "next_value": next_value,
        },
        batch_size=[len(lessons)],
    )


def canonical_or_none(points: NDArray, action: Action) -> Canonical | None:
    """A rope and action as they are learned; None for the rare rope whose image reads otherwise."""
    try:
        return canonicalise(points, action)
    except (DegenerateCurveError, IllegalActionError):
        return None

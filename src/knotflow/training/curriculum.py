"""What self-play tries next, rarely solved pairs more often, and what its trials teach."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.primitives.canonical import ARRANGE, Canonical, canonicalise
from knotflow.samplers.primitives.encoding import encode_canonical
from knotflow.topology import (
    R1,
    Action,
    DegenerateCurveError,
    ForwardAction,
    IllegalActionError,
    TopologicalState,
    parse_action,
)
from knotflow.topology.polyline import Floats

INNER_R1 = "inner R1"
"""The kind of R1 on a segment without a rope end."""

KIND_SHARES = {"R1": 2.0, INNER_R1: 0.5, "R2": 1.0, "C": 3.0}
"""Relative frequencies of the kinds of actions."""

UNDO = "undo"
"""The kind of all actions that undo another."""

Pair = tuple[TopologicalState, Action]
"""A state, and an action that it allows."""

FARTHEST_GRASP = 3.5
"""Largest distance, network units, from where an action grasps, of trials that teach anything."""

Value = Callable[[int, TensorDict], Tensor]
"""Given a primitive and encoded ropes [N], their values (N,)."""

ByCrossings = Mapping[int, Sequence[TopologicalState]]


@cache
def pairs_by_kind(state: TopologicalState, most_crossings: int) -> Mapping[str, tuple[Pair, ...]]:
    """Pairs of a state by kind of action, those of `KIND_SHARES`, which lead to at most so many
    crossings, and undo."""
    found: dict[str, list[Pair]] = {}
    for action, end in (*state.actions(), *state.undo_actions()):
        kind = action.symbol if isinstance(action, ForwardAction) else UNDO
        if isinstance(action, R1) and 0 < action.index < state.num_segments - 1:
            kind = INNER_R1
        if kind != UNDO and end.num_crossings > most_crossings:
            continue
        found.setdefault(kind, []).append((state, action))
    return {kind: tuple(pairs) for kind, pairs in found.items()}


def sampling_priority(rate: ArrayLike) -> Any:
    """Priority, 0..0.4, of what succeeds at a rate: highest at 1/3, 0 at 0 and 1."""
    rate = np.asarray(rate)
    return (1 - rate) * rate**0.5


@dataclass
class PairStats:
    """Outcomes of the trials of a pair."""

    trials: int = 0
    successes: int = 0
    rate: float = 0.0
    """Success rate, an exponential average over the last hundred trials or so."""

    def add(self, success: bool) -> None:
        self.trials += 1
        self.successes += success
        self.rate += (success - self.rate) / min(self.trials, 100)

    @property
    def priority(self) -> float:
        """`sampling_priority` of the rate, which is taken to be low until success is seen."""
        recent = min(self.trials, 100)
        return float(sampling_priority((recent * self.rate + 0.5) / (recent + 2.5)))


_UNTRIED = PairStats()


def _drawn_kind(kinds: Iterable[str], rng: np.random.Generator) -> str:
    names = sorted(kinds)
    shares = np.array([KIND_SHARES[name] for name in names])
    return names[rng.choice(len(names), p=shares / shares.sum())]


class Curriculum:
    """Counts trials of every pair, and draws pairs by priority."""

    def __init__(
        self, most_crossings: int, crossings_shares: Sequence[float], undo_share: float
    ) -> None:
        """`crossings_shares` are relative frequencies of states of 0, 1, 2, ... crossings,
        `undo_share` is the share of the draws that undo an action."""
        self.most_crossings, self.undo_share = most_crossings, undo_share
        self.crossings_shares = crossings_shares
        self.stats: dict[Pair, PairStats] = {}

    def add(self, state: TopologicalState, action: Action, success: bool) -> None:
        self.stats.setdefault((state, action), PairStats()).add(success)

    def by_crossings(self, states: Iterable[TopologicalState]) -> ByCrossings:
        """The states that are drawn at all, by their number of crossings."""
        found: dict[int, list[TopologicalState]] = {}
        for state in states:
            if state.num_crossings < len(self.crossings_shares):
                found.setdefault(state.num_crossings, []).append(state)
        return found

    def draw(self, by_crossings: ByCrossings, rng: np.random.Generator) -> Pair:
        """A pair: the number of crossings and the kind of action by share, then by priority."""
        shares = np.array([self.crossings_shares[count] for count in sorted(by_crossings)])
        crossings = sorted(by_crossings)[rng.choice(len(shares), p=shares / shares.sum())]
        some = by_crossings[crossings]
        # A few states, not all: there are thousands of pairs.
        some = [some[row] for row in rng.integers(len(some), size=8)]
        pairs: dict[str, list[Pair]] = {}
        for state in some:
            for kind, own in pairs_by_kind(state, self.most_crossings).items():
                pairs.setdefault(kind, []).extend(own)
        undoing = pairs.pop(UNDO, [])
        undo = undoing and (not pairs or rng.random() < self.undo_share)
        chosen = undoing if undo else pairs[_drawn_kind(pairs, rng)]
        priority = np.array([self.stats.get(pair, _UNTRIED).priority for pair in chosen])
        return chosen[rng.choice(len(chosen), p=priority / priority.sum())]

    def next_action(self, state: TopologicalState, rng: np.random.Generator) -> Action | None:
        """An action that may follow: a kind by its share, then any; None where none may."""
        pairs = pairs_by_kind(state, self.most_crossings)
        kinds = [kind for kind in pairs if kind != UNDO]
        if not kinds:
            return None
        some = pairs[_drawn_kind(kinds, rng)]
        return some[rng.integers(len(some))][1]

    def state_dict(self) -> dict[str, Any]:
        return {
            f"{state} {action}": (one.trials, one.successes, one.rate)
            for (state, action), one in self.stats.items()
            if one.trials
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.stats = {}
        for name, counts in state.items():
            before, action = name.split(" ", 1)
            pair = TopologicalState.parse(before), parse_action(action)
            self.stats[pair] = PairStats(*counts)


@dataclass(frozen=True)
class Query:
    """A rope (V, 3), its state, an action to do or arrange for, and its canonical rope."""

    points: Floats
    state: TopologicalState
    action: Action
    rope: Canonical


@dataclass(frozen=True)
class Transition:
    """A spline (6,) tried for a query, and where it led."""

    query: Query
    spline: Floats
    end_points: Floats
    end: TopologicalState | None
    arranging: bool = False
    """Whether it was to arrange the rope for the action instead of doing it."""
    value: float = 0.0
    """Of the action before."""

    @property
    def success(self) -> bool:
        """Whether it ended in the action's state."""
        return self.end == self.query.state.apply(self.query.action)

    @property
    def state_kept(self) -> bool:
        return self.end == self.query.state


@dataclass(frozen=True)
class Sample:
    """A transition as a training sample of its action's primitive, or of the arranging one."""

    transition: Transition
    arranging: bool
    reward: float
    next_action: Action | None
    """Valued at the end shape; None where nothing follows."""


def samples(
    transition: Transition,
    curriculum: Curriculum,
    arranging_share: float,
    rng: np.random.Generator,
) -> Iterator[Sample]:
    """A transition's samples: of its action, whether it succeeded and what may follow; of
    arranging (also from a share of the failed actions), whether the state was kept."""
    success, arranging = transition.success, transition.arranging
    if not arranging:
        yield acting_sample(transition, curriculum, rng)
    if not success and (arranging or rng.random() < arranging_share):
        kept = transition.state_kept
        yield Sample(transition, True, float(kept), transition.query.action if kept else None)


def acting_sample(
    transition: Transition, curriculum: Curriculum, rng: np.random.Generator
) -> Sample:
    """What a transition teaches of its action."""
    if transition.success and transition.end is not None:
        return Sample(transition, False, 1.0, curriculum.next_action(transition.end, rng))
    return Sample(transition, False, 0.0, None)


def encode_samples(some: Sequence[Sample], value: Value) -> Iterator[tuple[int, TensorDict]]:
    """Primitives and their samples, as `TransitionBuffer.extend` takes them."""
    by_number: dict[int, list[Sample]] = {}
    for sample in some:
        number = ARRANGE if sample.arranging else sample.transition.query.rope.primitive
        by_number.setdefault(number, []).append(sample)
    for number, own in sorted(by_number.items()):
        transitions = [sample.transition for sample in own]
        ropes = encode_canonical([one.query.rope for one in transitions], number == ARRANGE)
        world = np.stack([one.spline for one in transitions])
        splines = ropes.frames.to_network(world[:, None])[:, 0]
        rows = np.flatnonzero(np.abs(splines[:, 0]) <= FARTHEST_GRASP)
        if not len(rows):
            continue
        own = [own[row] for row in rows]
        columns = {
            "states": ropes.states[torch.from_numpy(rows)],
            "spline": torch.from_numpy(splines[rows]).float(),
            "reward": torch.tensor([sample.reward for sample in own]),
            "baseline": torch.tensor(
                [float(one.transition.value) if one.arranging else 0.0 for one in own]
            ),
        }
        columns |= _next_steps(own, columns["states"], value)
        yield number, TensorDict(columns, batch_size=[len(own)])


def _next_steps(
    some: Sequence[Sample], states: TensorDict, value: Value
) -> dict[str, Tensor | TensorDict]:
    """The samples' end shapes as the next actions' primitives see them, and their values."""
    next_states = states.select("streams", "grasp").apply(torch.zeros_like)
    next_primitive = torch.full((len(some),), -1)
    next_value = torch.full((len(some),), torch.nan)
    by_number: dict[int, list[tuple[int, Canonical]]] = {}
    for row, sample in enumerate(some):
        if sample.next_action is None:
            continue
        rope = canonical_or_none(sample.transition.end_points, sample.next_action)
        if rope is not None:
            by_number.setdefault(rope.primitive, []).append((row, rope))
    for number, own in by_number.items():
        rows = torch.tensor([row for row, _ in own])
        encoded = encode_canonical([rope for _, rope in own]).states.select("streams", "grasp")
        next_states[rows], next_primitive[rows] = encoded, number
        next_value[rows] = value(number, encoded)
    return {"next_states": next_states, "next_primitive": next_primitive, "next_value": next_value}


def canonical_or_none(points: Floats, action: Action) -> Canonical | None:
    """`canonicalise`, or None for the rare rope whose image reads otherwise."""
    try:
        return canonicalise(points, action)
    except (DegenerateCurveError, IllegalActionError):
        return None

"""What self-play tries next, rarely solved pairs more often."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from knotflow.topology import R1, Action, ForwardAction, TopologicalState, parse_action
from knotflow.training.config import SelfPlayConfig

INNER_R1 = "inner R1"
"""The kind of R1 on a segment without a rope end."""

KIND_SHARES = {"R1": 2.0, INNER_R1: 1.0, "R2": 2.0, "C": 3.0}
"""Relative frequencies of the kinds of actions."""

UNDO = "undo"
"""The kind of all actions that undo another."""

Pair = tuple[TopologicalState, Action]
"""A state, and an action that it allows."""

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

    def __init__(self, config: SelfPlayConfig) -> None:
        self.config = config
        self.stats: dict[Pair, PairStats] = {}

    def add(self, state: TopologicalState, action: Action, success: bool) -> None:
        self.stats.setdefault((state, action), PairStats()).add(success)

    def by_crossings(self, states: Iterable[TopologicalState]) -> ByCrossings:
        """The states that are drawn at all, by their number of crossings."""
        found: dict[int, list[TopologicalState]] = {}
        for state in states:
            if state.num_crossings < len(self.config.crossings_shares):
                found.setdefault(state.num_crossings, []).append(state)
        return found

    def draw(self, by_crossings: ByCrossings, rng: np.random.Generator) -> Pair:
        """A pair: the number of crossings and the kind of action by share, then by priority."""
        shares = np.array([self.config.crossings_shares[count] for count in sorted(by_crossings)])
        crossings = sorted(by_crossings)[rng.choice(len(shares), p=shares / shares.sum())]
        some = by_crossings[crossings]
        # A few states, not all: there are thousands of pairs.
        some = [some[row] for row in rng.integers(len(some), size=8)]
        pairs: dict[str, list[Pair]] = {}
        for state in some:
            for kind, own in pairs_by_kind(state, self.config.most_crossings).items():
                pairs.setdefault(kind, []).extend(own)
        undoing = pairs.pop(UNDO, [])
        undo = undoing and (not pairs or rng.random() < self.config.undo_share)
        chosen = undoing if undo else pairs[_drawn_kind(pairs, rng)]
        priority = np.array([self.stats.get(pair, _UNTRIED).priority for pair in chosen])
        return chosen[rng.choice(len(chosen), p=priority / priority.sum())]

    def next_action(self, state: TopologicalState, rng: np.random.Generator) -> Action | None:
        """An action that may follow: a kind by its share, then any; None where none may."""
        pairs = pairs_by_kind(state, self.config.most_crossings)
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

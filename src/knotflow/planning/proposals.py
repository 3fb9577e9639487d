"""What a search asks of a sampler, and how it does without what the sampler cannot do."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import ACT, ARRANGE, Branch, Node
from knotflow.planning.config import PlannerConfig
from knotflow.planning.goals import Goal
from knotflow.samplers.demonstrations import aim, aim_predicted, rearrange_predicted
from knotflow.samplers.sampler import Sampler, ability
from knotflow.topology import Action, Undo, segment_lengths

UNDONE = 0.3
"""Value of an undoing that is aimed: of random drags, 25 to 44 % take crossings back."""


class Proposals:
    """Splines for branches, and values for nodes, from one sampler.

    A sampler that cannot arrange nudges the rope, and one that cannot undo drags that are aimed;
    for one without a critic a shape is worth its `room`, whatever the action.
    """

    def __init__(
        self, sampler: Sampler, goal: Goal, config: PlannerConfig, rng: np.random.Generator
    ) -> None:
        self._sampler, self._goals, self._rng = sampler, goal.states, rng
        self._onward = (config.onward and ability(sampler, "sample_onward")) or sampler.sample
        self._arrange = ability(sampler, "arrange")
        self._judged = ability(sampler, "judged")
        self._undoes = "undo" not in getattr(sampler, "lacks", ())
        # The paper's rule takes a critic into account only where its value bias is set.
        paper = config.rule == "paper"
        arranging = not paper and config.arranging > 0
        blind = None if paper else _rooms
        self._values = ability(sampler, "values") or blind
        if paper and config.value_bias == 0:
            self._values = None
        self._arranged_values = ability(sampler, "arranged_values") if arranging else None
        self._guess_fraction = 0.0 if paper else config.guess_fraction
        self._guess_below_value = config.guess_below_value

    def splines(self, branches: Sequence[Branch]) -> Iterator[NDArray[np.float64]]:
        """Splines (B, 6) for the branches, a few (b, 6) at a time.

        The sampler is asked once for all branches in a row that are alike, see `together`.
        """
        for _, same in groupby(branches, _question):
            alike = list(same)
            yield self._ask(alike[0], len(alike))

    def _ask(self, branch: Branch, count: int) -> NDArray[np.float64]:
        """Splines (count, 6) for one branch: of the sampler, and of them some that are guessed."""
        points, rng = branch.node.points, self._rng
        if branch.kind == ARRANGE:
            learned = self._arrange
        else:
            learned = self._sampler.sample if branch.goal in self._goals else self._onward
        guesses = count
        if learned is not None and not self._aimed(branch.wanted):
            hardly = branch.node.values[branch.edge] < self._guess_below_value
            again = branch.node.successes[ACT, branch.edge] > 0  # for another shape than before
            mixed = branch.kind == ARRANGE or hardly or again
            guesses = rng.binomial(count, self._guess_fraction) if mixed else 0
        found = []
        if guesses:
            found.append(self._guess(branch, guesses))
        if guesses < count and learned is not None:
            found.append(learned(points, branch.wanted, count - guesses, rng))
        return np.concatenate(found)

    def _guess(self, branch: Branch, count: int) -> NDArray[np.float64]:
        """Guesses (count, 6), the best of many by the sampler's own estimate."""
        points, action, rng = branch.node.points, branch.wanted, self._rng
        blind = self._aimed(action)
        if branch.kind == ARRANGE:
            if self._values is None or blind:
                return aim(points, branch.action, count, rng)
            worth = partial(self._worth, action)
            return rearrange_predicted(points, action, count, rng, worth)
        judged = None if self._judged is None or blind else partial(self._judged, points, action)
        return aim_predicted(points, action, count, rng, judged)

    def _worth(self, action: Action, shapes: NDArray) -> NDArray[np.float64]:
        """Value (N,) of shapes (N, V, 3) for an action."""
        assert self._values is not None
        return self._values(shapes, [action] * len(shapes), self._rng)

    def _aimed(self, action: Action) -> bool:
        """Whether the action is an undoing that the sampler does not know."""
        return isinstance(action, Undo) and not self._undoes

    def appraise(self, nodes: Sequence[Node]) -> None:
        """Value the edges of new nodes, if values count."""
        pairs = [(node, action) for node in nodes for action, _ in node.edges]
        if self._values is None or not pairs:
            return
        known = np.array([not self._aimed(action) for _, action in pairs])
        values = np.full(len(pairs), UNDONE)
        arranged = values
        if known.any():
            points = np.stack(
                [node.points for (node, _), one in zip(pairs, known, strict=True) if one]
            )
            actions = [action for (_, action), one in zip(pairs, known, strict=True) if one]
            values[known] = self._values(points, actions, self._rng)
            arranged = values.copy()
            if self._arranged_values is not None:
                arranged[known] = self._arranged_values(points, actions, self._rng)
        ends = np.cumsum([len(node.edges) for node in nodes])[:-1]
        for node, own, after in zip(
            nodes, np.split(values, ends), np.split(arranged, ends), strict=True
        ):
            node.values, node.arranged_values = own, after


def together(branches: Sequence[Branch]) -> list[Branch]:
    """The branches with those side by side that ask the same of a sampler."""
    first: dict[Hashable, int] = {}
    return sorted(branches, key=lambda branch: first.setdefault(_question(branch), len(first)))


def _question(branch: Branch) -> Hashable:
    return id(branch.node), branch.edge, branch.kind


def room(points: NDArray) -> float:
    """How long the two shortest segments of a rope (V, 3) are, as a share of an even division.

    Between 0 and 1: ranking by it is arranging's critic where there is no other.
    """
    lengths = segment_lengths(points)
    return float(np.sort(lengths)[:2].mean() * len(lengths))


def _rooms(
    points: NDArray, actions: Sequence[Action], rng: np.random.Generator
) -> NDArray[np.float64]:
    return np.array([room(rope) for rope in points])

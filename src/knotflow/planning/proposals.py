"""What is asked of a sampler: proposals and values for a search, and attempts at one action."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.config import PlannerConfig
from knotflow.planning.goals import Goal
from knotflow.planning.hand import Reach
from knotflow.planning.rules import ACT, ARRANGE, Expansion, Node
from knotflow.samplers.demonstrations import (
    NoiseConfig,
    heuristic_splines,
    noisy_copies,
    screened_arranging_splines,
    screened_splines,
)
from knotflow.samplers.sampler import Sampler, capability, has_capability
from knotflow.simulation import Attempts, Observer, RopeSimulator, SplineError, check_splines
from knotflow.topology import Action, Arrange, TopologicalState, Undo, segment_lengths
from knotflow.topology.polyline import Floats

UNDO_VALUE = 0.3
"""Value of an undoing that is aimed: of random drags, 25 to 44 % take crossings back."""
MIN_GAIN = 0.05
"""A rope is arranged where the critic predicts at least so much more value after it."""
NOISE = NoiseConfig(grasp=0.02, middle=0.02, end=0.02)
"""Of the noisy copies of a spline that are tried in many worlds."""
RESAMPLED, LEAST_RESAMPLED = 4, 8
"""How often splines out of the arm's reach are replaced, and the least number sampled for that."""


class Proposals:
    """Splines for expansions and values for nodes, from one sampler.

    A sampler that cannot arrange is replaced by guesses, and one that cannot undo by aimed drags;
    without a critic the value of a shape is its `clearance`, whatever the action.
    """

    def __init__(
        self,
        sampler: Sampler,
        goal: Goal,
        config: PlannerConfig,
        rng: np.random.Generator,
        reach: Reach | None = None,
    ) -> None:
        self._reach = reach
        self._sampler, self._goals, self._rng = sampler, goal.states, rng
        sample_next = capability(sampler, "sample_for_next")
        self._sample_next = sample_next if config.use_next_value else None
        self._arrange = capability(sampler, "arrange")
        self._judged = capability(sampler, "success_probability")
        self._undoes = has_capability(sampler, "undo")
        paper = config.rule == "paper"  # takes no critic into account
        arranging = not paper and config.arranging > 0
        self._values = None if paper else capability(sampler, "values") or _clearances
        self._arranged_values = capability(sampler, "arranged_values") if arranging else None
        self._guess_fraction = 0.0 if paper else config.guess_fraction
        self._guess_below_value = config.guess_below_value

    def splines(self, expansions: Sequence[Expansion]) -> Iterator[Floats]:
        """Splines (b, 6) for each run of expansions with the same query (`group_by_query`).

        Rows are NaN where none was found in the arm's reach.
        """
        for _, same in groupby(expansions, _query):
            alike = list(same)
            yield self._within_reach(alike[0], len(alike))

    def for_worlds(
        self, expansion: Expansion, ropes: Floats, near: Floats | None, count: int
    ) -> Floats:
        """Splines (N, 6), N <= count, for a node whose rope is one of `ropes` (W, V, 3), metres.

        Those of the highest mean probability of success, out of proposals for each rope and noisy
        copies of a spline `near` (6,).
        """
        node, action, rng = expansion.node, expansion.edge_action, self._rng
        judge = None if self._is_aimed(action) else self._judged
        pool = [self._propose(expansion, count)]
        if near is not None:
            pool.append(noisy_copies(near, count, rng, NOISE))
        if judge is not None:
            pool += [self._sampler.sample(rope, action, 1, rng) for rope in ropes]
        found = self._reachable(node.points, np.concatenate(pool))
        if judge is None:
            return rng.permutation(found)[:count]
        judged = np.mean([judge(rope, action, found) for rope in ropes], axis=0)
        return found[np.argsort(-judged)[:count]]

    def near(self, points: Floats, spline: Floats, count: int) -> Floats:
        """A spline (6,) and noisy copies of it, (N, 6), N <= count: those in the arm's reach."""
        copies = noisy_copies(spline, count - 1, self._rng, NOISE)
        return self._reachable(points, np.concatenate([spline[None], copies]))

    def _reachable(self, points: Floats, splines: Floats) -> Floats:
        if self._reach is None:
            return splines
        return splines[self._reach.may_follow(points, splines)]

    def _within_reach(self, expansion: Expansion, count: int) -> Floats:
        found = self._propose(expansion, count)
        if self._reach is None:
            return found
        points = expansion.node.points
        found = self._reachable(points, found)
        for _ in range(RESAMPLED):
            if len(found) >= count:
                break
            more = self._propose(expansion, max(count, LEAST_RESAMPLED))
            found = np.concatenate([found, self._reachable(points, more)])
        return np.concatenate([found, np.full((count, 6), np.nan)])[:count]

    def _propose(self, expansion: Expansion, count: int) -> Floats:
        """Splines (count, 6) of the sampler, some of them guessed."""
        node, edge, action, rng = expansion.node, expansion.edge, expansion.edge_action, self._rng
        if expansion.kind == ARRANGE:
            learned = self._arrange
        elif expansion.goal in self._goals or self._sample_next is None:
            learned = self._sampler.sample
        else:
            learned = self._sample_next
        if learned is None or self._is_aimed(action):
            return self._guess(expansion, count)
        unlikely = node.values[edge] < self._guess_below_value
        again = node.successes[ACT, edge] > 0  # for another shape than before
        mixed = expansion.kind == ARRANGE or unlikely or again
        guesses = rng.binomial(count, self._guess_fraction) if mixed else 0
        found = [self._guess(expansion, guesses)] if guesses else []
        if guesses < count:
            splines = check_splines(learned(node.points, action, count - guesses, rng))
            if splines.shape != (count - guesses, 6):
                raise SplineError(
                    f"the sampler was asked for {count - guesses} splines and gave an array of "
                    f"shape {splines.shape}, in place of {(count - guesses, 6)}"
                )
            found.append(splines)
        return np.concatenate(found)

    def _guess(self, expansion: Expansion, count: int) -> Floats:
        """Guesses (count, 6), the best of many by the sampler's own estimate."""
        points, action, rng = expansion.node.points, expansion.edge_action, self._rng
        aimed = self._is_aimed(action)
        if expansion.kind != ARRANGE:
            judge = None if aimed else self._judged
            judged = None if judge is None else partial(judge, points, action)
            return screened_splines(points, action, count, rng, judged)
        values = self._values
        if values is None or aimed:
            return heuristic_splines(points, expansion.action, count, rng)

        def value(shapes: Floats) -> Floats:
            return values(shapes, [action] * len(shapes), rng)

        return screened_arranging_splines(points, action, count, rng, value)

    def _is_aimed(self, action: Action) -> bool:
        """Whether the action is an undoing that the sampler does not know."""
        return isinstance(action, Undo) and not self._undoes

    def evaluate(self, nodes: Sequence[Node]) -> None:
        """Value the edges of new nodes, if values count."""
        pairs = [(node, action) for node in nodes for action, _ in node.edges]
        if self._values is None or not pairs:
            return
        known = np.array([not self._is_aimed(action) for _, action in pairs])
        values = np.full(len(pairs), UNDO_VALUE)
        arranged = values
        if known.any():
            asked = [pair for pair, one in zip(pairs, known, strict=True) if one]
            points = np.stack([node.points for node, _ in asked])
            actions = [action for _, action in asked]
            values[known] = self._values(points, actions, self._rng)
            arranged = values.copy()
            if self._arranged_values is not None:
                arranged[known] = self._arranged_values(points, actions, self._rng)
        ends = np.cumsum([len(node.edges) for node in nodes])[:-1]
        parts = zip(nodes, np.split(values, ends), np.split(arranged, ends), strict=True)
        for node, own, after in parts:
            node.values, node.arranged_values = own, after


def group_by_query(expansions: Sequence[Expansion]) -> list[Expansion]:
    """The expansions with those next to each other that ask the same of a sampler."""
    first: dict[Hashable, int] = {}
    return sorted(expansions, key=lambda one: first.setdefault(_query(one), len(first)))


def _query(expansion: Expansion) -> Hashable:
    return id(expansion.node), expansion.edge, expansion.kind


def clearance(points: Floats) -> float:
    """Mean length of the two shortest segments of a rope (V, 3), relative to an even division."""
    lengths = segment_lengths(points)
    return float(np.sort(lengths)[:2].mean() * len(lengths))


def prospect(node: Node) -> float:
    """How promising a node is: its clearance times its best value."""
    return clearance(node.points) * float(node.values.max(initial=0.0) if node.edges else 1.0)


def _clearances(points: Floats, actions: Sequence[Action], rng: np.random.Generator) -> Floats:
    return np.array([clearance(rope) for rope in points])


def attempt_arranged(
    points: Floats,
    action: Action,
    start: TopologicalState,
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    most: int = 3,
    observe: Observer | None = None,
) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Try an action on ropes (B, V, 3), metres, arranging each before by up to `most` splines.

    An arranging spline that loses the state ends the attempt (Sec. VIII). A sampler that cannot
    arrange, or value the gain, acts at once. All ropes are in the state `start`.

    Returns:
        (B,) whether the rope at rest has exactly the state that the action leads to, and (B,)
        number of splines executed, arranging ones included.

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
    return success, used

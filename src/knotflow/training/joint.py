"""Joint finetuning on a task of several steps (Sec. V-B c).

Episodes lead from untangled ropes along the paths of a solution DAG to a knot. Each step draws an
edge of the DAG, whose primitive learns from the step; the reward at the end, 1 if the knot is tied,
reaches the earlier steps as the values of those that follow.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.primitives.canonical import primitive_of
from knotflow.simulation import random_curve
from knotflow.topology import Action, TopologicalState, knot, segment_lengths, solution_graph
from knotflow.topology.polyline import Floats
from knotflow.training.config import JointConfig
from knotflow.training.trainer import Metrics
from knotflow.training.transitions import (
    Query,
    Sample,
    Transition,
    TransitionTrainer,
    canonical_or_none,
    policy_success,
)


class JointFinetuning(TransitionTrainer):
    """Trains those primitives of a library that a knot's DAG needs on episodes that tie it.

    "tied" is the share of the episodes that tied the knot, "splines" their mean length.
    """

    config: JointConfig

    def prepare(self) -> Iterable[int]:
        self._goals = knot(self.config.goal)
        self._actions: dict[TopologicalState, list[Action]] = {}
        """Those of the DAG that a primitive does, by state."""
        numbers = set()
        graph = solution_graph(*sorted(self._goals))
        for state, _, action in sorted(graph.edges(data="action"), key=lambda one: str(one[2])):
            if (number := primitive_of(action, state.num_segments)) in self.library.primitives:
                numbers.add(number)
                self._actions.setdefault(state, []).append(action)
        return numbers

    def collect(self) -> Metrics:
        config, rope, start = self.config, self.simulator.config.rope, TopologicalState.trivial()
        open_ = [
            (random_curve(rope, self.rng, self.starts), start) for _ in range(config.environments)
        ]
        tried: list[Transition] = []
        for _ in range(config.splines):
            queries = [one for rope in open_ if (one := self._query(*rope)) is not None]
            if not queries:
                break
            new = self.execute(queries, *self._propose(queries))
            open_ = [
                (one.end_points, one.end)
                for one in new
                if one.end is not None and self._goes_on(one.end_points, one.end)
            ]
            tried += new
        self.store([self.sample(one) for one in tried])
        return policy_success(tried) | {
            "tied": sum(one.end in self._goals for one in tried) / config.environments,
            "splines": len(tried) / config.environments,
        }

    def _query(self, points: Floats, state: TopologicalState) -> Query | None:
        """An action of the DAG; None for the rare rope on which it cannot be read."""
        actions = self._actions[state]
        action = actions[self.rng.integers(len(actions))]
        canonical = canonical_or_none(points, action, self.simulator.config.rope)
        return None if canonical is None else Query(points, state, action, canonical)

    def _propose(self, queries: Sequence[Query]) -> tuple[Floats, NDArray[np.int64]]:
        """Splines (N, 6), for success and what it is worth, and the way each was proposed."""
        splines, ways = np.empty((len(queries), 6)), np.empty(len(queries), np.int64)
        kinds = [
            (one.canonical.primitive, one.state.apply(one.action) not in self._goals)
            for one in queries
        ]
        for kind in sorted(set(kinds)):
            rows = [row for row, one in enumerate(kinds) if one == kind]
            splines[rows], ways[rows] = self.explore(
                kind[0], [queries[row].canonical for row in rows], use_next_value=kind[1]
            )
        return splines, ways

    def _goes_on(self, points: Floats, state: TopologicalState) -> bool:
        """Whether an episode goes on from a rope (V, 3)."""
        shortest = self.config.shortest_segment
        return state in self._actions and bool((segment_lengths(points) >= shortest).all())

    def sample(self, transition: Transition) -> Sample:
        end = transition.end
        if not transition.success or end is None:
            return Sample(transition, 0.0)
        if end in self._goals:
            return Sample(transition, 1.0, next_value=1.0)
        if end not in self._actions:  # after an action of independent training
            return Sample(transition, 1.0)
        if not self._goes_on(transition.end_points, end):
            return Sample(transition, 1.0, next_value=0.0)
        return Sample(transition, 1.0, self._actions[end])

"""Joint finetuning on a task of several steps (Sec. V-B c).

Episodes lead from untangled ropes along the paths of a solution DAG to a knot. Each step draws an
edge of the DAG, whose primitive learns from the step; the reward at the end, 1 if the knot is tied,
reaches the earlier steps as the values of those that follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.primitives.canonical import primitive_of
from knotflow.samplers.primitives.library import PrimitiveLibrary
from knotflow.simulation import (
    Attempts,
    RopeSimulator,
    StartsConfig,
    Trials,
    end_states,
    random_curve,
)
from knotflow.topology import Action, TopologicalState, knot, segment_lengths, solution_graph
from knotflow.topology.polyline import Floats
from knotflow.training.config import JointConfig
from knotflow.training.learner import POLICY
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

    Metrics of a primitive are losses, and the success rate of the policy's own splines. "tied" is
    the share of the episodes that tied the knot, "splines" the mean length of an episode.
    """

    config: JointConfig

    def __init__(
        self,
        library: PrimitiveLibrary,
        trials: Mapping[Action, Sequence[Trials]],
        earlier: Sequence[Attempts],
        simulator: RopeSimulator,
        config: JointConfig,
        seed: int,
        starts: StartsConfig | None = None,
    ) -> None:
        """See `TransitionTrainer`; `earlier` are attempts of independent training."""
        self._goals = knot(config.goal)
        found = [
            (state, action, primitive_of(action, state.num_segments))
            for state, _, action in solution_graph(*sorted(self._goals)).edges(data="action")
        ]
        numbers = library.primitives.keys() & {number for _, _, number in found}
        super().__init__(library, trials, simulator, config, seed, starts, sorted(numbers))
        self._actions: dict[TopologicalState, list[Action]] = {}
        """Those that lead on, by state."""
        for state, action, number in sorted(found, key=lambda one: (one[0], str(one[1]))):
            if number in numbers:
                self._actions.setdefault(state, []).append(action)
        for attempts in earlier:
            self.add_earlier(attempts)

    def collect(self) -> Metrics:
        """A round of episodes."""
        config, rope, start = self.config, self.simulator.config.rope, TopologicalState.trivial()
        open_ = [
            (random_curve(rope, self.rng, self.starts), start) for _ in range(config.environments)
        ]
        tried: list[Transition] = []
        by_policy: list[Transition] = []
        for _ in range(config.splines):
            queries = [one for rope in open_ if (one := self._query(*rope)) is not None]
            if not queries:
                break
            splines, ways = self._propose(queries)
            rollouts = self.simulator.execute(np.stack([one.points for one in queries]), splines)
            outcomes = splines, rollouts.end_points, end_states(rollouts)
            new = [Transition(*one) for one in zip(queries, *outcomes, strict=True)]
            tried += new
            by_policy += [one for one, way in zip(new, ways, strict=True) if way == POLICY]
            open_ = [
                (one.end_points, one.end)
                for one in new
                if one.end is not None and self._goes_on(one.end_points, one.end)
            ]
        self.store([self.sample(one) for one in tried])
        tied = sum(one.end in self._goals for one in tried)
        return policy_success(by_policy) | {
            "tied": tied / config.environments,
            "splines": len(tried) / config.environments,
        }

    def _query(self, points: Floats, state: TopologicalState) -> Query | None:
        """An action of the DAG; None for the rare rope on which it cannot be read."""
        actions = self._actions[state]
        action = actions[self.rng.integers(len(actions))]
        canonical = canonical_or_none(points, action)
        return None if canonical is None else Query(points, state, action, canonical)

    def _propose(self, queries: Sequence[Query]) -> tuple[Floats, NDArray[np.int64]]:
        """Splines (N, 6), for success and what it is worth, and the way each was proposed."""
        splines, ways = np.empty((len(queries), 6)), np.empty(len(queries), np.int64)
        kinds = [
            (one.rope.primitive, one.state.apply(one.action) not in self._goals) for one in queries
        ]
        for kind in sorted(set(kinds)):
            rows = [row for row, one in enumerate(kinds) if one == kind]
            splines[rows], ways[rows] = self.explore(
                kind[0], [queries[row].rope for row in rows], use_next_value=kind[1]
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

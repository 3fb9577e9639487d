"""Joint finetuning on a task of several steps (Sec. V-B c).

Episodes lead from untangled ropes along the paths of a solution DAG to a knot. Each step draws an
edge of the DAG, whose primitive learns from the step; the reward at the end, 1 if the knot is tied,
reaches the earlier steps as the values of those that follow.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.primitives.canonical import primitive_of
from knotflow.simulation import RopeConfig, random_curve
from knotflow.topology import Action, TopologicalState, knot, segment_lengths, solution_graph
from knotflow.topology.polyline import Floats
from knotflow.training.config import EpisodesConfig, JointConfig
from knotflow.training.trainer import Metrics
from knotflow.training.transitions import (
    Query,
    Sample,
    Transition,
    TransitionTrainer,
    canonical_or_none,
    policy_success,
)


@dataclass(frozen=True)
class Task:
    """States to reach, and the actions that lead there."""

    goals: frozenset[TopologicalState]
    actions: Mapping[TopologicalState, Sequence[Action]]
    """Those of the DAG that a primitive does, by state."""

    @classmethod
    def of(cls, goals: Iterable[TopologicalState], primitives: Container[int]) -> Self:
        """The task of reaching any of some states, with primitives of these numbers."""
        actions: dict[TopologicalState, list[Action]] = {}
        graph = solution_graph(*sorted(goals))
        for state, _, action in sorted(graph.edges(data="action"), key=lambda one: str(one[2])):
            if primitive_of(action, state.num_segments) in primitives:
                actions.setdefault(state, []).append(action)
        return cls(frozenset(goals), actions)

    @property
    def primitives(self) -> set[int]:
        """Numbers of the primitives that do its actions."""
        return {
            primitive_of(action, state.num_segments)
            for state, actions in self.actions.items()
            for action in actions
        }


@dataclass(frozen=True)
class Episode:
    """A rope (V, 3) on its way to a task's goal."""

    task: Task
    rope: RopeConfig
    points: Floats
    state: TopologicalState


class EpisodeTrainer(TransitionTrainer):
    """Trains primitives on episodes.

    "tied" is the share of the episodes that reached their goal, "splines" their mean length.
    """

    config: EpisodesConfig

    @abstractmethod
    def begin(self) -> Episode:
        """A new episode."""

    def untangled(self, task: Task, rope: RopeConfig) -> Episode:
        """An episode that begins with a random curve of a rope."""
        points = random_curve(rope, self.rng, self.starts)
        return Episode(task, rope, points, TopologicalState.trivial())

    def collect(self) -> Metrics:
        config = self.config
        open_ = [self.begin() for _ in range(config.environments)]
        tried: list[tuple[Task, Transition]] = []
        for _ in range(config.splines):
            asked = [(one, query) for one in open_ if (query := self._query(one)) is not None]
            if not asked:
                break
            episodes = [one for one, _ in asked]
            queries = [query for _, query in asked]
            new = self.execute(queries, *self._propose(episodes, queries))
            tried += [(one.task, step) for one, step in zip(episodes, new, strict=True)]
            open_ = [
                replace(one, points=step.end_points, state=step.end)
                for one, step in zip(episodes, new, strict=True)
                if step.end is not None and self._goes_on(one.task, step.end_points, step.end)
            ]
        self.store([self.sample_of(*one) for one in tried])
        return policy_success([step for _, step in tried]) | {
            "tied": sum(step.end in task.goals for task, step in tried) / config.environments,
            "splines": len(tried) / config.environments,
        }

    def _query(self, episode: Episode) -> Query | None:
        """An action of the DAG; None for the rare rope on which it cannot be read."""
        actions = episode.task.actions[episode.state]
        action = actions[int(self.rng.integers(len(actions)))]
        canonical = canonical_or_none(episode.points, action, episode.rope)
        if canonical is None:
            return None
        return Query(episode.points, episode.state, action, canonical)

    def _propose(
        self, episodes: Sequence[Episode], queries: Sequence[Query]
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Splines (N, 6), for success and what it is worth, and the way each was proposed."""
        splines, ways = np.empty((len(queries), 6)), np.empty(len(queries), np.int64)
        kinds = [
            (one.canonical.primitive, one.state.apply(one.action) not in episode.task.goals)
            for episode, one in zip(episodes, queries, strict=True)
        ]
        for kind in sorted(set(kinds)):
            rows = [row for row, one in enumerate(kinds) if one == kind]
            splines[rows], ways[rows] = self.explore(
                kind[0], [queries[row].canonical for row in rows], use_next_value=kind[1]
            )
        return splines, ways

    def _goes_on(self, task: Task, points: Floats, state: TopologicalState) -> bool:
        """Whether an episode goes on from a rope (V, 3)."""
        shortest = self.config.shortest_segment
        return state in task.actions and bool((segment_lengths(points) >= shortest).all())

    def sample_of(self, task: Task, transition: Transition) -> Sample:
        """What a transition teaches of its action, as a step of a task."""
        end = transition.end
        if not transition.success or end is None:
            return Sample(transition, 0.0)
        if end in task.goals:
            return Sample(transition, 1.0, next_value=1.0)
        if end not in task.actions:  # after an action of independent training
            return Sample(transition, 1.0)
        if not self._goes_on(task, transition.end_points, end):
            return Sample(transition, 1.0, next_value=0.0)
        return Sample(transition, 1.0, task.actions[end])


class JointFinetuning(EpisodeTrainer):
    """Trains those primitives of a library that a knot's DAG needs on episodes that tie it."""

    config: JointConfig

    def prepare(self) -> Iterable[int]:
        self._task = Task.of(knot(self.config.goal), self.library.primitives)
        return self._task.primitives

    def begin(self) -> Episode:
        return self.untangled(self._task, self.simulator.config.rope)

    def sample(self, transition: Transition) -> Sample:
        return self.sample_of(self._task, transition)

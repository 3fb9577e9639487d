"""Finetuning on knots: joint finetuning (Sec. V-B c) to many goals, on any rope, in many worlds.

It follows self-play, which learns all actions alike: on the paths to the knots that people tie, the
primitives learn which splines leave a rope that most worlds can go on with.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from knotflow.samplers.primitives.canonical import ARRANGE
from knotflow.topology import TopologicalState, all_states, knot
from knotflow.training.config import KnotsConfig
from knotflow.training.joint import Episode, EpisodeTrainer, Task
from knotflow.training.many_ropes import ManyRopes
from knotflow.training.transitions import Sample, Transition


class KnotFinetuning(ManyRopes, EpisodeTrainer):
    """Trains the acting primitives of a library on episodes, each with a goal of its own."""

    config: KnotsConfig

    def prepare(self) -> Iterable[int]:
        self.prepare_ropes()
        knots, shares = self.config.knots, self.config.crossings_shares
        self._knots = [self._task(*knot(name)) for name in knots]
        weights = np.array([*knots.values(), *shares])
        self._weights = weights / weights.sum()
        return set(self.library.primitives) - {ARRANGE}

    def begin(self) -> Episode:
        drawn = int(self.rng.choice(len(self._weights), p=self._weights)) - len(self._knots)
        if drawn < 0:
            task = self._knots[drawn]
        else:
            states = all_states(drawn)
            task = self._task(states[self.rng.integers(len(states))])
        return self.untangled(task, self.draw_rope())

    def sample(self, transition: Transition) -> Sample:
        """What an attempt of independent training teaches, which had no task."""
        return Sample(transition, float(transition.success))

    def _task(self, *goals: TopologicalState) -> Task:
        return Task.of(goals, self.library.primitives)

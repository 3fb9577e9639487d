"""Self-play: all primitives learn all actions together, from ropes that they made.

Joint finetuning over all paths of all solution DAGs. A trial draws a kept shape and an action that
its state allows, and does the action or arranges the rope for it; the shape it leaves is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import screened_arranging_splines, screened_splines
from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE, Canonical, canonicalise
from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.encoding import KINDS, encode_canonical
from knotflow.samplers.primitives.library import PrimitiveLibrary
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.simulation import (
    Attempts,
    RopeConfig,
    random_curve,
    state_or_none,
)
from knotflow.topology import Action, TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.topology.symmetry import representative
from knotflow.training.buffers import StateBuffer
from knotflow.training.config import SelfPlayConfig
from knotflow.training.curriculum import Curriculum, sampling_priority
from knotflow.training.many_ropes import ManyRopes
from knotflow.training.trainer import Metrics
from knotflow.training.transitions import (
    Query,
    Sample,
    Transition,
    canonical_or_none,
    policy_success,
)

HEURISTIC = -1
"""A way in which a spline is proposed, beside those of `exploration`."""


class SelfPlay(ManyRopes):
    """Trains the primitives of a `completed` library on all actions."""

    config: SelfPlayConfig

    def prepare(self) -> Iterable[int]:
        self.curriculum = Curriculum(self.config)
        self.shapes = StateBuffer(self.config.shapes)
        self.prepare_ropes()
        return self.library.primitives

    def collect(self) -> Metrics:
        queries, values = self._draw()
        splines, arranging, ways = self._propose(queries, values)
        transitions = self.execute(queries, splines, ways, arranging.tolist(), values)
        learned: list[Sample] = []
        for one in transitions:
            if not one.arranging:
                self.curriculum.add(one.query.state, one.query.action, one.success)
            learned += self.samples(one)
            if one.end is not None and one.end.num_crossings <= self.config.most_crossings:
                self._keep(one.end_points, one.end, self.ropes.index(one.query.canonical.rope))
        self.store(learned)
        stats = self.curriculum.stats.values()
        return policy_success(transitions) | {
            "states": len(self.shapes),
            "pairs_tried": sum(pair.trials > 0 for pair in stats),
            "pairs_solved": sum(pair.successes > 0 for pair in stats),
        }

    def _draw(self) -> tuple[list[Query], Floats]:
        """What to try, and the actions' values."""
        count, rng = self.config.trials * self.config.candidates, self.rng
        trivial = TopologicalState.trivial()
        known = self.curriculum.by_crossings(
            [trivial, *(state for state in self.shapes if state != trivial)]
        )
        drawn: list[Query] = []
        while len(drawn) < count:
            state, action = self.curriculum.draw(known, rng)
            if state == trivial and (state not in self.shapes or rng.random() < 0.5):
                rope = self.draw_rope()
                shape = random_curve(rope, rng, self.starts)
            else:
                shape, number = self.shapes.draw(state, rng)
                rope = self.ropes[number]
            if (canonical := canonical_or_none(shape, action, rope)) is not None:
                drawn.append(Query(shape, state, action, canonical))
        values = self._values([query.canonical for query in drawn])
        # The least weight lets the critic's errors be found out.
        weight = sampling_priority(values) + 0.05
        rows = rng.choice(count, self.config.trials, replace=False, p=weight / weight.sum())
        return [drawn[row] for row in rows], values[rows]

    def _propose(
        self, queries: Sequence[Query], values: Floats
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.intp]]:
        """Splines (N, 6), whether each is to arrange the rope, and the way it was proposed."""
        config, rng, count = self.config, self.rng, len(queries)
        arranging = (values < config.arrange_below_value) & (
            rng.random(count) < config.arranging_share
        )
        splines, ways = np.empty((count, 6)), np.full(count, HEURISTIC, np.intp)
        guessed = rng.random(count) < np.where(
            arranging | (values < config.guess_below_value), config.guess_fraction, 0.0
        )
        numbers = np.where(arranging, ARRANGE, [query.canonical.primitive for query in queries])
        for number in sorted(set(numbers.tolist())):
            rows = np.flatnonzero((numbers == number) & ~guessed).tolist()
            if not rows:
                continue
            use_next_value = number == ARRANGE or bool(rng.random() < 0.5)
            ropes = [queries[row].canonical for row in rows]
            splines[rows], ways[rows] = self.explore(number, ropes, use_next_value)
        for row in np.flatnonzero(guessed).tolist():
            points, action = queries[row].points, queries[row].action
            rope = queries[row].canonical.rope
            if arranging[row]:
                value = partial(self._values_for, action, rope)
                splines[row] = screened_arranging_splines(points, action, 1, rng, value)[0]
            else:
                library = self.library.for_rope(rope)
                success = partial(library.success_probability, points, action)
                splines[row] = screened_splines(points, action, 1, rng, success)[0]
        return splines, arranging, ways

    def sample(self, transition: Transition) -> Sample:
        if not transition.success or transition.end is None:
            return Sample(transition, 0.0)
        action = self.curriculum.next_action(transition.end, self.rng)
        return Sample(transition, 1.0, () if action is None else (action,))

    def samples(self, transition: Transition) -> Iterator[Sample]:
        """Of acting, and, of arranging or a share of what failed, whether the state was kept; of
        arranging that did the action instead, nothing."""
        arranging = transition.arranging
        if not arranging:
            yield self.sample(transition)
        learns = arranging or self.rng.random() < self.config.arranging_share
        if learns and not transition.success:
            kept = transition.state_kept
            following = (transition.query.action,) if kept else ()
            yield Sample(transition, float(kept), following, arranging=True)

    def add_earlier(self, attempts: Attempts) -> None:
        super().add_earlier(attempts)
        action, state = attempts.action, attempts.start
        start, symmetry = representative(state)
        pair = start, symmetry.of_action(action, state.num_segments)
        ends = attempts.rollouts.end_points
        for points, end, success in zip(attempts.points, ends, attempts.success, strict=True):
            self.curriculum.add(*pair, bool(success))
            self._keep(points, state)
            if success:
                self._keep(end, attempts.goal)

    def _keep(self, points: Floats, state: TopologicalState, rope: int = 0) -> None:
        """Keep a shape of a rope, if its mirror image reads as the representative state does."""
        first, symmetry = representative(state)
        if state_or_none(symmetry.of_points(points)) == first:
            self.shapes.add(points, state, self.rng, rope)

    def _values(self, ropes: Sequence[Canonical]) -> Floats:
        """Value (S,) of each rope for its action."""
        values = np.empty(len(ropes))
        numbers = np.array([rope.primitive for rope in ropes])
        for number in sorted(set(numbers.tolist())):
            rows = np.flatnonzero(numbers == number)
            states = encode_canonical([ropes[row] for row in rows.tolist()]).states
            values[rows] = self.value(number, states).numpy()
        return values

    def _values_for(self, action: Action, rope: RopeConfig, shapes: Floats) -> Floats:
        return self._values([canonicalise(shape, action, rope) for shape in shapes])

    @property
    def parts(self) -> dict[str, Any]:
        return {**super().parts, "shapes": self.shapes, "curriculum": self.curriculum}


def completed(library: PrimitiveLibrary, seed: int) -> PrimitiveLibrary:
    """A library with new primitives for what it lacks."""
    primitives, actions = dict(library.primitives), dict(library.trained_on)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for number in set(ALL_PRIMITIVES) - set(primitives):
            config = PrimitiveConfig()
            if number == ARRANGE:
                config.network.kinds = KINDS
            primitives[number], actions[number] = Primitive(config), ()
    return PrimitiveLibrary(primitives, actions, library.rope)

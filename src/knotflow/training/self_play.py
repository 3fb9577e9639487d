"""Self-play: all primitives learn together, from ropes that they made (Sec. V-B c, and beyond).

Joint finetuning over all paths of all solution DAGs. A trial draws a kept shape and an action that
its state allows, and does the action or arranges the rope for it; the shape it leaves is kept.
Demonstrations and attempts of independent training stay in the replay buffers.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.demonstrations import Task, screened_arranging_splines, screened_splines
from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE, Canonical, canonicalise
from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.encoding import KINDS, encode_canonical
from knotflow.samplers.primitives.library import PrimitiveLibrary
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.seeding import rng_of
from knotflow.simulation import (
    Attempts,
    RopeSimulator,
    StartsConfig,
    Trials,
    end_states,
    random_curve,
    state_or_none,
)
from knotflow.threads import one_thread
from knotflow.topology import Action, TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.topology.symmetry import representative
from knotflow.training.buffers import StateBuffer, TransitionBuffer
from knotflow.training.config import SelfPlayConfig
from knotflow.training.curriculum import (
    Curriculum,
    Query,
    Sample,
    Transition,
    acting_sample,
    canonical_or_none,
    encode_samples,
    samples,
    sampling_priority,
)
from knotflow.training.learner import (
    POLICY,
    Learner,
    demonstration_buffer,
    explore,
    fit_each,
    is_reset_round,
)
from knotflow.training.trainer import Metrics, Trainer

HEURISTIC = -1
"""A way in which a spline is proposed, beside those of `exploration`."""
CHUNK = 64
"""Ropes whose values are searched for at a time, to bound memory."""


class SelfPlay(Trainer):
    """Trains the primitives of `library` on all actions.

    Metrics are named "primitive/metric": losses; of the policy's own splines the success rate, and
    of arranging ones the mean gain in value. Primitive 1's also count the known states and pairs.
    """

    def __init__(
        self,
        library: PrimitiveLibrary,
        trials: Mapping[Task, Sequence[Trials]],
        earlier: Sequence[Attempts],
        simulator: RopeSimulator,
        config: SelfPlayConfig,
        seed: int,
        starts: StartsConfig | None = None,
    ) -> None:
        """Trains the library's primitives, and those that it lacks from scratch.

        Args:
            library: after independent training, with actor and critic.
            trials: demonstrations, of one rope each.
            earlier: attempts of independent training.
            starts: what an untangled rope looks like.

        Raises:
            ValueError: a primitive of the library lacks actor or critic.
        """
        super().__init__(config.rounds)
        self.simulator, self.config = simulator, config
        self.library = _completed(library, seed)
        self._starts = starts or StartsConfig()
        self._rng = rng_of(seed, 0)
        self.curriculum = Curriculum(
            config.most_crossings, config.crossings_shares, config.undo_share
        )
        self.shapes = StateBuffer(config.shapes)
        self.buffers: dict[int, TransitionBuffer] = {}
        self._learners = {
            number: self._learner(number, trials, seed) for number in self.library.primitives
        }
        for attempts in earlier:
            self._add_earlier(attempts)

    def step(self) -> Metrics:
        done, config = len(self.history) + 1, self.config
        with one_thread():
            metrics = self._collect()
        for buffer in self.buffers.values():
            buffer.refresh(self._value, config.refreshed)
        for number, losses in self._fit(config.steps, config.new_steps).items():
            metrics[number] |= losses
        if is_reset_round(done, config.critic_reset_every, config.rounds):
            self._fit(config.critic_reset_steps, config.critic_reset_steps, reset=True)
        return {
            f"{number}/{name}": value
            for number, own in metrics.items()
            for name, value in own.items()
        }

    def _collect(self) -> dict[int, Metrics]:
        """One batch of trials, into the replay buffers; metrics by primitive."""
        queries, values = self._draw()
        splines, arranging, ways = self._propose(queries, values)
        rollouts = self.simulator.execute(np.stack([one.points for one in queries]), splines)
        outcomes = splines, rollouts.end_points, end_states(rollouts), arranging.tolist(), values
        transitions = [Transition(*one) for one in zip(queries, *outcomes, strict=True)]
        learned: list[Sample] = []
        for one in transitions:
            if not one.arranging:
                self.curriculum.add(one.query.state, one.query.action, one.success)
            learned += samples(one, self.curriculum, self.config.arranging_share, self._rng)
            if one.end is not None and one.end.num_crossings <= self.config.most_crossings:
                self._keep(one.end_points, one.end)
        self._store(learned)
        return self._metrics(transitions, ways)

    def _draw(self) -> tuple[list[Query], Floats]:
        """What to try, and the actions' values."""
        count = self.config.ropes * self.config.candidates
        rope, rng = self.simulator.config.rope, self._rng
        trivial = TopologicalState.trivial()
        known = self.curriculum.by_crossings(
            [trivial, *(state for state in self.shapes if state != trivial)]
        )
        drawn: list[Query] = []
        while len(drawn) < count:
            state, action = self.curriculum.draw(known, rng)
            if state == trivial and (state not in self.shapes or rng.random() < 0.5):
                shape = random_curve(rope, rng, self._starts)
            else:
                shape = self.shapes.draw(state, rng)
            if (canonical := canonical_or_none(shape, action)) is not None:
                drawn.append(Query(shape, state, action, canonical))
        values = self._values([query.rope for query in drawn])
        # The least weight lets the critic's errors be found out.
        weight = sampling_priority(values) + 0.05
        rows = rng.choice(count, self.config.ropes, replace=False, p=weight / weight.sum())
        return [drawn[row] for row in rows], values[rows]

    def _propose(
        self, queries: Sequence[Query], values: Floats
    ) -> tuple[Floats, NDArray[np.bool_], NDArray[np.intp]]:
        """Splines (N, 6), whether each is to arrange the rope, and the way it was proposed."""
        config, rng, count = self.config, self._rng, len(queries)
        progress = len(self.history) / max(1, config.rounds - 1)
        arranging = (values < config.arrange_below_value) & (
            rng.random(count) < config.arranging_share
        )
        splines, ways = np.empty((count, 6)), np.full(count, HEURISTIC, np.intp)
        guessed = rng.random(count) < np.where(
            arranging | (values < config.guess_below_value), config.guess_fraction, 0.0
        )
        numbers = np.where(arranging, ARRANGE, [query.rope.primitive for query in queries])
        for number in sorted(set(numbers.tolist())):
            rows = np.flatnonzero((numbers == number) & ~guessed).tolist()
            if not rows:
                continue
            encoded = encode_canonical([queries[row].rope for row in rows], number == ARRANGE)
            use_next_value = number == ARRANGE or bool(rng.random() < 0.5)
            network, ways[rows] = explore(
                self.library.primitives[number], encoded, 1, config.exploration, progress, rng,
                use_next_value,
            )  # fmt: skip
            splines[rows] = encoded.frames.to_world(network.numpy())[:, 0]
        for row in np.flatnonzero(guessed).tolist():
            points, action = queries[row].points, queries[row].action
            if arranging[row]:
                value = partial(self._values_for, action)
                splines[row] = screened_arranging_splines(points, action, 1, rng, value)[0]
            else:
                success = partial(self.library.success_probability, points, action)
                splines[row] = screened_splines(points, action, 1, rng, success)[0]
        return splines, arranging, ways

    def _add_earlier(self, attempts: Attempts) -> None:
        action, state, goal = attempts.action, attempts.start, attempts.goal
        learned = []
        columns = attempts.points, attempts.splines, attempts.success, attempts.rollouts.end_points
        for points, spline, success, end_points in zip(*columns, strict=True):
            if (rope := canonical_or_none(points, action)) is not None:
                query, end = Query(points, state, action, rope), goal if success else None
                one = Transition(query, spline, end_points, end)
                learned.append(acting_sample(one, self.curriculum, self._rng))
            self._keep(points, state)
            if success:
                self._keep(end_points, goal)
        start, symmetry = representative(state)
        pair = start, symmetry.of_action(action, state.num_segments)
        for success in attempts.success:
            self.curriculum.add(*pair, bool(success))
        self._store(learned)

    def _keep(self, points: Floats, state: TopologicalState) -> None:
        """Keep a shape, if its mirror image reads as the representative state does."""
        first, symmetry = representative(state)
        if state_or_none(symmetry.of_points(points)) == first:
            self.shapes.add(points, state, self._rng)

    def _store(self, learned: Sequence[Sample]) -> None:
        for number, trials in encode_samples(learned, self._value):
            self.buffers[number].extend(trials)

    def _values(self, ropes: Sequence[Canonical]) -> Floats:
        """Value (S,) of each rope for its action."""
        values = np.empty(len(ropes))
        numbers = np.array([rope.primitive for rope in ropes])
        for number in sorted(set(numbers.tolist())):
            rows = np.flatnonzero(numbers == number)
            states = encode_canonical([ropes[row] for row in rows.tolist()]).states
            values[rows] = self._value(number, states).numpy()
        return values

    def _values_for(self, action: Action, shapes: Floats) -> Floats:
        return self._values([canonicalise(shape, action) for shape in shapes])

    def _value(self, number: int, states: TensorDict) -> Tensor:
        return best_values(self.library.primitives[number], states, self._rng)

    def _fit(self, steps: int, new_steps: int, reset: bool = False) -> dict[int, Metrics]:
        """Gradient steps of all primitives; without demonstrations, as many as successes allow."""
        each = self.config.successes_per_step
        most = {
            number: min(new_steps, self.buffers[number].num_successes // each)
            if learner.demonstrations is None
            else steps
            for number, learner in self._learners.items()
        }
        ready = {number: learner for number, learner in self._learners.items() if most[number]}
        return fit_each(ready, most, reset)

    def _metrics(
        self, transitions: Sequence[Transition], ways: NDArray[np.intp]
    ) -> dict[int, Metrics]:
        """What the policy's own splines achieved."""
        metrics: dict[int, Metrics] = {number: {} for number in self.library.primitives}
        achieved: dict[int, list[bool]] = {}
        arranged: list[tuple[Canonical, float]] = []
        for one, way in zip(transitions, ways, strict=True):
            if way != POLICY:
                continue
            if not one.arranging:
                achieved.setdefault(one.query.rope.primitive, []).append(one.success)
                continue
            achieved.setdefault(ARRANGE, []).append(one.state_kept)
            rope = canonical_or_none(one.end_points, one.query.action) if one.state_kept else None
            if rope is not None:
                arranged.append((rope, one.value))
        for number, own in achieved.items():
            metrics[number]["policy_success"] = float(np.mean(own))
        if arranged:
            after = self._values([rope for rope, _ in arranged])
            before = np.array([value for _, value in arranged])
            metrics[ARRANGE]["gain"] = float((after - before).mean())
        stats = self.curriculum.stats.values()
        metrics[1] |= {
            "states": len(self.shapes),
            "pairs_tried": sum(pair.trials > 0 for pair in stats),
            "pairs_solved": sum(pair.successes > 0 for pair in stats),
        }
        return metrics

    def _learner(self, number: int, trials: Mapping[Task, Sequence[Trials]], seed: int) -> Learner:
        config = self.config.learner
        if number == ARRANGE:  # what counts is what is gained
            config = replace(config, success_share=0.0, failure_weight=1.0, gains_only=True)
        learner = Learner(self.library.primitives[number], config, seed + number)
        own = [
            one
            for some in trials.values()
            for one in some
            if canonicalise(some[0].points[0], one.action).primitive == number
        ]
        if own:
            learner.demonstrations = demonstration_buffer(own, learner.generator)
        learner.rollouts = TransitionBuffer(self.config.capacity, learner.generator)
        self.buffers[number] = learner.rollouts
        return learner

    @property
    def parts(self) -> dict[str, Any]:
        learned = {"learners": self._learners, "shapes": self.shapes}
        return {**learned, "curriculum": self.curriculum, "rng": self._rng}


def best_values(primitive: Primitive, states: TensorDict, rng: np.random.Generator) -> Tensor:
    """`Primitive.values` (N,) of ropes [N], in chunks on all cores."""
    chunks = [states[begin : begin + CHUNK] for begin in range(0, len(states), CHUNK)]
    noises = [primitive.value_noise(len(some), rng) for some in chunks]
    with one_thread(), ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(primitive.values, chunks, noises))
    return torch.cat(found) if found else torch.zeros(0)


def _completed(library: PrimitiveLibrary, seed: int) -> PrimitiveLibrary:
    """The library with new primitives for what it lacks."""
    primitives, actions = dict(library.primitives), dict(library.trained_on)
    for number, primitive in primitives.items():
        if primitive.actor is None or primitive.critic is None:
            raise ValueError(
                f"self-play needs primitives with actor and critic, but primitive {number} is "
                f"{primitive.config.variant}"
            )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for number in set(ALL_PRIMITIVES) - set(primitives):
            config = PrimitiveConfig()
            if number == ARRANGE:
                config.network.kinds = KINDS
            primitives[number], actions[number] = Primitive(config), ()
    return PrimitiveLibrary(primitives, actions, library.rope)

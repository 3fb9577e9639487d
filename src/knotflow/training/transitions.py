"""Primitives that learn together, each from its own transitions (Sec. V-B c).

A transition that succeeds is worth the value of the best action that follows at its end shape.
Demonstrations and attempts of independent training stay in the replay buffers.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.primitives.canonical import ARRANGE, Canonical, canonicalise, primitive_of
from knotflow.samplers.primitives.encoding import encode_canonical
from knotflow.samplers.primitives.library import PrimitiveLibrary
from knotflow.seeding import rng_of
from knotflow.simulation import (
    Attempts,
    RopeConfig,
    RopeSimulator,
    StartsConfig,
    Trials,
    end_states,
)
from knotflow.threads import cpus, one_thread
from knotflow.topology import Action, DegenerateCurveError, IllegalActionError, TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.training.buffers import TransitionBuffer
from knotflow.training.config import TransitionConfig
from knotflow.training.learner import (
    POLICY,
    Learner,
    demonstration_buffer,
    explore,
    fit_each,
    is_reset_round,
)
from knotflow.training.trainer import Metrics, Trainer

CHUNK = 64
"""Ropes whose values are searched for at a time, to bound memory."""
FARTHEST_GRASP = 3.5
"""Largest distance, network units, from where an action grasps, of trials that teach anything."""

Value = Callable[[int, TensorDict], Tensor]
"""Given a primitive and encoded ropes [N], their values (N,)."""


@dataclass(frozen=True)
class Query:
    """A rope (V, 3), its state, an action to do or arrange for, and its canonical rope."""

    points: Floats
    state: TopologicalState
    action: Action
    canonical: Canonical


@dataclass(frozen=True)
class Transition:
    """A spline (6,) tried for a query, and where it led."""

    query: Query
    spline: Floats
    end_points: Floats
    end: TopologicalState | None
    way: int = POLICY  # in which the spline was proposed
    arranging: bool = False  # the rope for the action, instead of doing it
    value: float = 0.0  # of the action before

    @property
    def success(self) -> bool:
        return self.end == self.query.state.apply(self.query.action)

    @property
    def state_kept(self) -> bool:
        return self.end == self.query.state


@dataclass(frozen=True)
class Sample:
    """A transition as a training sample of its action's primitive, or of the arranging one.

    Its next value is that of the best of `next_actions` at the end shape, or `next_value`, NaN if
    unknown.
    """

    transition: Transition
    reward: float
    next_actions: Sequence[Action] = ()
    next_value: float = np.nan
    arranging: bool = False


class TransitionTrainer(Trainer):
    """Trains the primitives of `library`; metrics of one are named "primitive/metric"."""

    def __init__(
        self,
        library: PrimitiveLibrary,
        trials: Mapping[Action, Sequence[Trials]],
        earlier: Sequence[Attempts],
        simulator: RopeSimulator,
        config: TransitionConfig,
        seed: int,
        starts: StartsConfig | None = None,
    ) -> None:
        """`trials` are demonstrations of one rope each, `earlier` attempts of independent training.

        Raises:
            ValueError: a primitive of the library lacks actor or critic.
        """
        super().__init__(config.rounds)
        for number, primitive in library.primitives.items():
            if primitive.actor is None or primitive.critic is None:
                raise ValueError(
                    "primitives that learn together have actor and critic, but primitive "
                    f"{number} is {primitive.config.variant}"
                )
        self.simulator, self.config = simulator, config
        self.starts = starts or StartsConfig()
        self.library = PrimitiveLibrary(
            library.primitives, library.trained_on, library.rope, True, library.proportions
        )
        self.rng = rng_of(seed, 0)
        self.buffers: dict[int, TransitionBuffer] = {}
        self._learners = {
            number: self._learner(number, trials, seed) for number in sorted(self.prepare())
        }
        for attempts in earlier:
            self.add_earlier(attempts)

    def _learner(
        self, number: int, trials: Mapping[Action, Sequence[Trials]], seed: int
    ) -> Learner:
        config = self.config.learner
        if number == ARRANGE:  # what counts is what is gained
            config = replace(config, success_share=0.0, failure_weight=1.0, gains_only=True)
        learner = Learner(self.library.primitives[number], config, seed + number)
        own = [
            one
            for some in trials.values()
            for one in some
            if primitive_of(one.action, one.start.num_segments) == number
        ]
        if own:
            rope = self.simulator.config.rope
            learner.demonstrations = demonstration_buffer(own, learner.generator, rope)
        learner.rollouts = TransitionBuffer(self.config.capacity, learner.generator)
        self.buffers[number] = learner.rollouts
        return learner

    @abstractmethod
    def prepare(self) -> Iterable[int]:
        """Make what `sample` and `collect` need; the numbers of the primitives that learn."""

    @abstractmethod
    def collect(self) -> Metrics:
        """Simulate splines and `store` what they teach."""

    @abstractmethod
    def sample(self, transition: Transition) -> Sample:
        """What a transition teaches of its action."""

    def add_earlier(self, attempts: Attempts) -> None:
        """Store what attempts of independent training teach."""
        action, state, goal = attempts.action, attempts.start, attempts.goal
        columns = attempts.points, attempts.splines, attempts.success, attempts.rollouts.end_points
        learned, rope = [], self.simulator.config.rope
        for points, spline, success, end_points in zip(*columns, strict=True):
            if (canonical := canonical_or_none(points, action, rope)) is not None:
                query, end = Query(points, state, action, canonical), goal if success else None
                learned.append(self.sample(Transition(query, spline, end_points, end)))
        self.store(learned)

    def step(self) -> Metrics:
        done, config = len(self.history) + 1, self.config
        with one_thread():
            metrics = self.collect()
        for buffer in self.buffers.values():
            buffer.refresh(self.value, config.refreshed)
        for number, losses in self._fit(config.steps, config.new_steps).items():
            metrics |= {f"{number}/{name}": value for name, value in losses.items()}
        if is_reset_round(done, config.critic_reset_every, config.rounds):
            self._fit(config.critic_reset_steps, config.critic_reset_steps, reset=True)
        return metrics

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

    def explore(
        self, number: int, ropes: Sequence[Canonical], use_next_value: bool
    ) -> tuple[Floats, NDArray[np.int64]]:
        """The behaviour policy's spline (N, 6) of a primitive on each rope, and its way (N,)."""
        encoded = encode_canonical(ropes, number == ARRANGE)
        network, ways = explore(
            self.library.primitives[number], encoded, 1, self.config.exploration,
            len(self.history) / max(1, self.rounds - 1), self.rng, use_next_value,
        )  # fmt: skip
        return encoded.frames.to_world(network.numpy())[:, 0], ways

    def execute(
        self, queries: Sequence[Query], splines: Floats, *further: Iterable[Any]
    ) -> list[Transition]:
        """Simulate a spline (N, 6) for each query; `further` are columns of the transitions."""
        columns = queries, splines, *self.simulate(queries, splines), *further
        return [Transition(*one) for one in zip(*columns, strict=True)]

    def simulate(
        self, queries: Sequence[Query], splines: Floats
    ) -> tuple[Iterable[Floats], Sequence[TopologicalState | None]]:
        """Shapes (V, 3) at rest after splines (N, 6), and their states."""
        rollouts = self.simulator.execute(np.stack([one.points for one in queries]), splines)
        return rollouts.end_points, end_states(rollouts)

    def store(self, learned: Sequence[Sample]) -> None:
        """Put samples into the replay buffers of their primitives, if these learn."""
        for number, trials in encode_samples(learned, self.value):
            if number in self.buffers:
                self.buffers[number].extend(trials)

    def value(self, number: int, states: TensorDict) -> Tensor:
        """`Primitive.values` (N,) of ropes [N], in chunks on all cores."""
        primitive = self.library.primitives[number]
        chunks = [states[begin : begin + CHUNK] for begin in range(0, len(states), CHUNK)]
        noises = [primitive.value_noise(len(some), self.rng) for some in chunks]
        with one_thread(), ThreadPoolExecutor(cpus()) as pool:
            found = list(pool.map(primitive.values, chunks, noises))
        return torch.cat(found) if found else torch.zeros(0)

    @property
    def parts(self) -> dict[str, Any]:
        learners = {number: learner.parts for number, learner in self._learners.items()}
        return {"learners": learners, "rng": self.rng}


def policy_success(transitions: Sequence[Transition]) -> Metrics:
    """The success rate of each primitive's own splines, or how often they kept the state."""
    achieved: dict[int, list[bool]] = {}
    for one in (one for one in transitions if one.way == POLICY):
        number = ARRANGE if one.arranging else one.query.canonical.primitive
        achieved.setdefault(number, []).append(one.state_kept if one.arranging else one.success)
    return {f"{number}/policy_success": float(np.mean(own)) for number, own in achieved.items()}


def encode_samples(some: Sequence[Sample], value: Value) -> Iterator[tuple[int, TensorDict]]:
    """Primitives and their samples, as `TransitionBuffer.extend` takes them."""
    by_number: dict[int, list[Sample]] = {}
    for sample in some:
        number = ARRANGE if sample.arranging else sample.transition.query.canonical.primitive
        by_number.setdefault(number, []).append(sample)
    for number, own in sorted(by_number.items()):
        transitions = [sample.transition for sample in own]
        ropes = encode_canonical([one.query.canonical for one in transitions], number == ARRANGE)
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
    """The samples' end shapes as their best next actions' primitives see them, and their values."""
    next_states = states.select("streams", "grasp").apply(torch.zeros_like)
    next_primitive = torch.full((len(some),), -1)
    next_value = torch.tensor([sample.next_value for sample in some])
    by_number: dict[int, list[tuple[int, Canonical]]] = {}
    for row, sample in enumerate(some):
        for action in sample.next_actions:
            before = sample.transition.query.canonical
            rope = canonical_or_none(sample.transition.end_points, action, before.rope)
            if rope is not None:
                by_number.setdefault(rope.primitive, []).append((row, rope))
    for number, own in by_number.items():
        encoded = encode_canonical([rope for _, rope in own]).states.select("streams", "grasp")
        found = value(number, encoded)
        for (row, _), state, one in zip(own, encoded, found, strict=True):
            if not one <= next_value[row]:  # or NaN, where there is none yet
                next_states[row], next_primitive[row], next_value[row] = state, number, one
    return {"next_states": next_states, "next_primitive": next_primitive, "next_value": next_value}


def canonical_or_none(
    points: Floats, action: Action, rope: RopeConfig | None = None
) -> Canonical | None:
    """`canonicalise`, or None for the rare rope whose image reads otherwise."""
    try:
        return canonicalise(points, action, rope)
    except (DegenerateCurveError, IllegalActionError):
        return None

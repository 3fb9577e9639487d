"""Independent training of a primitive: imitation, then reinforcement (Sec. V-B a and b)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import Task
from knotflow.samplers.primitives.canonical import primitive_of
from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.encoding import encode
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.simulation import Attempts, RopeSimulator, StartsConfig, Trials, is_roomy
from knotflow.topology import segment_lengths
from knotflow.training.buffers import InitialStateBuffer, TrialBuffer
from knotflow.training.config import ImitationConfig, ReinforcementConfig
from knotflow.training.learner import (
    POLICY,
    SPREAD,
    Learner,
    demonstration_buffer,
    explore,
    is_reset_round,
)
from knotflow.training.trainer import Metrics, Trainer

Observer = Callable[[int, Sequence[Attempts]], None]
"""Called with the number of a round and its attempts, a batch a task."""


class Imitation(Trainer):
    """Trains `primitive` on demonstrations; a round ends with a validation."""

    def __init__(
        self,
        trials: Sequence[Sequence[Trials]],
        primitive: PrimitiveConfig,
        config: ImitationConfig,
        seed: int,
    ) -> None:
        """Draws weights and what is held out; `trials` are, for each action, of one rope each.

        Raises:
            ValueError: there are no trials.
        """
        super().__init__(config.validations)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.primitive = Primitive(primitive)
        self.config = config
        self.learner = Learner(self.primitive, config.learner, seed)
        rng = np.random.default_rng(seed)
        learned, held_out = [], []
        for some in trials:
            ends = np.cumsum([len(one) for one in some])
            drawn = rng.permutation(ends[-1]) < max(1, round(config.held_out * ends[-1]))
            for one, held in zip(some, np.split(drawn, ends[:-1]), strict=True):
                learned.append(one[~held])
                held_out.append(one[held])
        generator = self.learner.generator
        self.learner.demonstrations = demonstration_buffer(learned, generator)
        unseen = demonstration_buffer(held_out, generator)
        self._validation = unseen.sample(len(unseen), unseen.slots)

    def step(self) -> Metrics:
        self.primitive.train()
        return self.learner.fit(self.config.steps)

    @torch.no_grad()
    def validate(self) -> Metrics:
        """Losses on the held-out trials."""
        measured = self.learner.measure(self._validation, self._validation)
        return {f"validation_{key}": float(value) for key, value in measured.items()}

    @property
    def parts(self) -> dict[str, Any]:
        return {"learner": self.learner.parts}


class Reinforcement(Trainer):
    """Trains `primitive` on its own attempts and on demonstrations.

    Metrics are losses, and the success rate of the policy's own splines for each action.
    """

    def __init__(
        self,
        primitive: Primitive,
        trials: Sequence[Trials],
        pools: Mapping[Task, NDArray[np.float64]],
        simulator: RopeSimulator,
        config: ReinforcementConfig,
        seed: int,
        starts: StartsConfig | None = None,
        observe: Observer | None = None,
    ) -> None:
        """Goes on training a `primitive` that has imitated.

        `trials` are demonstrations, of one rope each; `pools` are start shapes (P, V, 3), metres.
        """
        task = next(iter(pools))
        number = primitive_of(task.action, task.start_state.num_segments)
        super().__init__(config.rounds[number - 1])
        self._room = config.room[number - 1]
        self.primitive, self.simulator, self.config = primitive, simulator, config
        self.learner = Learner(primitive, config.learner, seed)
        generator = self.learner.generator
        capacity = self.rounds * config.ropes * len(pools)
        self.rollouts = self.learner.rollouts = TrialBuffer(capacity, config.splines, generator)
        # Of a task's action, some may be from another state, where another primitive does it.
        own = [one for one in trials if primitive_of(one.action, one.start.num_segments) == number]
        if own:
            rope = simulator.config.rope
            self.learner.demonstrations = demonstration_buffer(own, generator, rope)
        self._rng = np.random.default_rng(seed)
        self._starts = starts or StartsConfig()
        self._observe = observe
        self._tasks = list(pools)
        recycling = config.recycled_share, config.recycled_capacity
        self._initial = {
            task.start_state: InitialStateBuffer(pool, *recycling) for task, pool in pools.items()
        }

    def step(self) -> Metrics:
        done, config = len(self.history) + 1, self.config
        metrics = self._attempt() | self.learner.fit(config.steps)
        if is_reset_round(done, config.critic_reset_every, self.rounds):
            self.learner.fit(config.critic_reset_steps, reset=True)
        return metrics

    def _attempt(self) -> Metrics:
        """Try splines on start shapes of every task, and put them into the replay buffer."""
        config = self.config
        progress = len(self.history) / max(1, self.rounds - 1)
        proposed = []
        for task in self._tasks:
            ropes = self._initial[task.start_state].draw(config.ropes, self._rng)
            encoded = encode(ropes, [task.action] * len(ropes), rope=self.simulator.config.rope)
            network, ways = explore(
                self.primitive, encoded, config.splines, config.exploration, progress, self._rng
            )
            splines = encoded.frames.to_world(network.numpy())  # (ropes, splines, 6), clipped
            points = np.repeat(ropes, config.splines, axis=0)
            proposed.append((task, encoded, points, splines, np.repeat(ways, config.splines)))
        # All tasks in one batch keep the simulator's threads busy.
        rollouts = self.simulator.execute(
            np.concatenate([points for _, _, points, _, _ in proposed]),
            np.concatenate([splines.reshape(-1, 6) for _, _, _, splines, _ in proposed]),
        )
        attempts, metrics, rope = [], {}, self.simulator.config.rope
        size = config.ropes * config.splines
        for number, (task, encoded, points, splines, ways) in enumerate(proposed):
            own = rollouts[number * size : (number + 1) * size]
            tried = Attempts.of(task.action, task.start_state, points, splines.reshape(-1, 6), own)
            attempts.append(tried)
            self.rollouts.extend(
                encoded.states,
                list(torch.from_numpy(encoded.frames.to_network(splines)).float()),
                list(torch.from_numpy(self._rewarded(tried).reshape(splines.shape[:2])).float()),
            )
            # Shapes that attempts left in a start state can be started from.
            for state, buffer in self._initial.items():
                roomy = [
                    end == state and is_roomy(points, rope, self._starts)
                    for end, points in zip(tried.ends, own.end_points, strict=True)
                ]
                buffer.recycle(own.end_points[roomy])
            for way, name in ((POLICY, "policy"), (SPREAD, "exploration")):
                if (ways == way).any():
                    rate = tried.success[ways == way].mean()
                    metrics[f"{name}_success/{task.action}"] = float(rate)
        if self._observe is not None:
            self._observe(len(self.history), attempts)
        return metrics

    def _rewarded(self, tried: Attempts) -> NDArray[np.bool_]:
        """Which of N attempts succeed and leave room (N,)."""
        rewarded = tried.success.copy()
        for row in np.flatnonzero(rewarded).tolist():
            rewarded[row] = segment_lengths(tried.rollouts.end_points[row]).min() >= self._room
        return rewarded

    @property
    def parts(self) -> dict[str, Any]:
        return {"learner": self.learner.parts, "initial": self._initial, "rng": self._rng}

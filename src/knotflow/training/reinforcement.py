"""Reinforcement: a primitive goes on learning from its own attempts (Sec. V-B b).

Rounds of: fresh start shapes, the behaviour policy, the simulator, the replay buffer, gradient
steps on demonstrations and attempts alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import Task, Trials
from knotflow.samplers.primitives.encoding import Encoded, encode
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.simulation import Attempts, RopeSimulator, StartsConfig, is_roomy
from knotflow.training.buffer import TrialBuffer
from knotflow.training.config import ReinforcementConfig
from knotflow.training.exploration import POLICY, SPREAD, explore
from knotflow.training.fitting import fit, settles
from knotflow.training.learner import Learner, demonstration_buffer
from knotflow.training.resumable import Resumable
from knotflow.training.shapes import StartPool


@dataclass(frozen=True)
class Round:
    """One round: what it measured, and all that it simulated."""

    index: int
    """Counted from 0."""
    metrics: dict[str, float]
    """Losses, and for each action the success rate of the policy's own splines on these starts,
    which are those of training."""
    attempts: tuple[Attempts, ...]
    """One item a task."""


class Reinforcement(Resumable):
    """Training on attempts; iterating over it trains, and gives a `Round` at a time.

        for round in training:
            record(round.attempts); training.save(folder)
        primitive = training.primitive

    The same arguments give the same weights on one machine. It may be interrupted after any round,
    and goes on from what was saved.
    """

    def __init__(
        self,
        primitive: Primitive,
        trials: Sequence[Trials],
        pools: Mapping[Task, NDArray],
        simulator: RopeSimulator,
        config: ReinforcementConfig,
        seed: int,
        starts: StartsConfig | None = None,
    ) -> None:
        """Takes over `primitive` and goes on training it.

        Args:
            primitive: after imitation.
            trials: the demonstrations, which stay in the replay buffer; may be empty.
            pools: for each task of this primitive, start shapes (P, V, 3) in its start state,
                metres, from which every round draws; more of them generalise better. Tasks with
                the same start state have the same.
            simulator: executes the attempts.
            config: the effort to spend.
            seed: everything random comes from it.
            starts: what a start looks like, for those that attempts leave behind.

        Raises:
            ValueError: there is no task, or a pool is empty.
        """
        for task, pool in pools.items():
            if len(pool) == 0:
                raise ValueError(f"the pool of start shapes for {task.action} is empty")
        if not pools:
            raise ValueError("reinforcement needs a pool of start shapes for at least one task")
        self.primitive, self.simulator, self.config = primitive, simulator, config
        self.learner = Learner(primitive, config.learner, seed)
        self.learner.rollouts = TrialBuffer(
            config.rounds * config.ropes * len(pools), config.splines, self.learner.generator
        )
        if trials:
            self.learner.demonstrations = demonstration_buffer(
                [(some, np.ones(len(some), bool)) for some in trials], self.learner.generator
            )
        self._rng = np.random.default_rng(seed)
        self._starts = starts or StartsConfig()
        self._tasks = list(pools)
        self._pools = {
            task.start_state: StartPool(pool, config.recycled_share, config.recycled_capacity)
            for task, pool in pools.items()
        }
        self._done = 0

    def __iter__(self) -> Iterator[Round]:
        while self._done < self.config.rounds:
            attempts, metrics = self._attempt()
            metrics |= fit(self.learner, self.config.steps)
            self._done += 1
            if settles(self._done, self.config.settle_every, self.config.rounds):
                fit(self.learner, self.config.settle_steps, settling=True)
            yield Round(self._done - 1, metrics, attempts)

    def state_dict(self) -> dict[str, Any]:
        return {
            "learner": self.learner.state_dict(),
            "pools": {str(state): pool.state_dict() for state, pool in self._pools.items()},
            "rng": self._rng.bit_generator.state,
            "done": self._done,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.learner.load_state_dict(state["learner"])
        for name, pool in self._pools.items():
            pool.load_state_dict(state["pools"][str(name)])
        self._rng.bit_generator.state = state["rng"]
        self._done = state["done"]

    def _attempt(self) -> tuple[tuple[Attempts, ...], dict[str, float]]:
        """Try splines on fresh starts of every task, and put them into the replay buffer."""
        config, rng = self.config, self._rng
        proposed = []
        for task in self._tasks:
            ropes = self._pools[task.start_state].draw(config.ropes, rng)
            encoded = encode(ropes, [task.action] * len(ropes))
            network, ways = explore(
                self.primitive, encoded, config.splines, config.exploration, self._progress, rng
            )
            splines = encoded.frames.to_world(network.numpy())
            points = np.repeat(ropes, config.splines, axis=0)
            proposed.append((task, encoded, points, splines, ways))
        # All tasks in one batch keep the simulator's threads busy.
        rollouts = self.simulator.execute(
            np.concatenate([points for _, _, points, _, _ in proposed]),
            np.concatenate([splines.reshape(-1, 6) for _, _, _, splines, _ in proposed]),
        )
        attempts, metrics = [], {}
        each = config.ropes * config.splines
        for number, (task, encoded, points, splines, ways) in enumerate(proposed):
            mine = rollouts[number * each : (number + 1) * each]
            flat = splines.reshape(-1, 6)
            tried = Attempts.of(task.action, task.start_state, points, flat, mine)
            success, way_of_each = tried.success, np.repeat(ways, config.splines)
            self._remember(encoded, splines, success.reshape(splines.shape[:2]))
            self._leave(tried)
            attempts.append(tried)
            for way, name in ((POLICY, "policy"), (SPREAD, "exploration")):
                if (way_of_each == way).any():
                    metrics[f"{name}_success/{task.action}"] = float(
                        success[way_of_each == way].mean()
                    )
        return tuple(attempts), metrics

    def _leave(self, tried: Attempts) -> None:
        """Ropes that an attempt left in a start state can be started from."""
        rope = self.simulator.config.rope
        for state, pool in self._pools.items():
            rows = [
                row
                for row, end in enumerate(tried.ends)
                if end == state and is_roomy(tried.rollouts.end_points[row], rope, self._starts)
            ]
            pool.recycle(tried.rollouts.end_points[rows])

    def _remember(self, encoded: Encoded, splines: NDArray, success: NDArray) -> None:
        # Splines were clipped into range: what was tried is what is remembered.
        tried = torch.from_numpy(encoded.frames.to_network(splines)).float()
        assert isinstance(self.learner.rollouts, TrialBuffer)
        self.learner.rollouts.extend(
            encoded.states, list(tried), list(torch.from_numpy(success.astype(np.float32)))
        )

    @property
    def _progress(self) -> float:
        """0 in the first round, 1 in the last."""
        return self._done / max(1, self.config.rounds - 1)

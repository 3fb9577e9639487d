"""Gradient steps of adapted QT-Opt on demonstrations and rollouts (Fig. 5, green arrows).

Beyond the paper, critics are reset now and then (Nikishin et al., "The Primacy Bias in Deep
Reinforcement Learning", ICML 2022).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event, Lock
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.primitives.encoding import encode
from knotflow.samplers.primitives.networks import Critic
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.simulation import Trials
from knotflow.threads import one_thread
from knotflow.training.buffers import TransitionBuffer, TrialBuffer, augment, mix
from knotflow.training.config import LearnerConfig
from knotflow.training.losses import actor_loss, critic_loss

_GLOBAL_GENERATOR = Lock()
"""Learners run in threads, but new weights come from PyTorch's one global generator."""


class Learner:
    """A primitive, its losses and optimiser, and the two replay buffers it learns from."""

    def __init__(self, primitive: Primitive, config: LearnerConfig, seed: int) -> None:
        self.primitive, self.config = primitive, config
        self.generator = torch.Generator().manual_seed(seed)
        self.demonstrations: TrialBuffer | None = None
        self.rollouts: TrialBuffer | TransitionBuffer | None = None
        networks = ((primitive.actor, 1.0), (primitive.critic, config.critic_reset_boost))
        groups = [
            {"params": list(network.parameters()), "boost": boost}
            for network, boost in networks
            if network is not None
        ]
        self.optimizer = torch.optim.AdamW(
            groups, config.learning_rate, weight_decay=config.weight_decay
        )

    def reset_critic(self) -> None:
        """Give the critic, if there is one, new weights."""
        critic = self.primitive.critic
        if critic is None:
            return
        seed = int(torch.randint(2**31, (), generator=self.generator))
        with _GLOBAL_GENERATOR, torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            fresh = Critic(self.primitive.config.network)
        critic.load_state_dict(fresh.state_dict())
        for parameter in critic.parameters():
            self.optimizer.state.pop(parameter, None)

    def update(self, rate: float = 1.0, after_reset: bool = False) -> dict[str, float]:
        """One gradient step; the losses and their companions.

        Args:
            rate: fraction of the learning rate.
            after_reset: whether the critic's learning rate is boosted.

        Raises:
            ValueError: there is nothing to learn from.
        """
        config, parts, shares = self.config, [], []
        if self.demonstrations:
            ropes, trials = config.demonstration_ropes, config.demonstration_trials
            parts.append(self.demonstrations.sample(ropes, trials))
            shares.append(config.demonstration_share)
        if self.rollouts:
            parts.append(self.rollouts.sample(config.rollout_ropes, config.rollout_trials))
            shares.append(1 - config.demonstration_share)
        if not parts:
            raise ValueError("a learner needs demonstrations or rollouts before it can update")
        batch = augment(mix(parts, shares), config.augmentation, self.generator)
        measured = self.measure(batch)
        self.optimizer.zero_grad(set_to_none=True)
        losses = [value for key, value in measured.items() if key.startswith("loss_")]
        torch.autograd.backward(torch.stack(losses).sum())
        torch.nn.utils.clip_grad_norm_(self.primitive.parameters(), config.gradient_norm)
        for group in self.optimizer.param_groups:
            boost = group["boost"] if after_reset else 1.0
            group["lr"] = rate * boost * config.learning_rate
        self.optimizer.step()
        return {key: float(value.detach()) for key, value in measured.items()}

    def measure(self, batch: TensorDict) -> dict[str, Tensor]:
        """The losses of a batch and their companions."""
        config, actor, critic = self.config, self.primitive.actor, self.primitive.critic
        out = {} if critic is None else critic_loss(critic, batch)
        if actor is not None:
            out |= actor_loss(
                actor, batch, config.failure_weight, config.success_share, config.gains_only
            )
        return out

    def fit(self, steps: int, reset: bool = False, stop: Event | None = None) -> dict[str, float]:
        """Gradient steps; the means of what `update` gives.

        Args:
            steps: how many.
            reset: reset the critic, and let the learning rate fall linearly to 0.
            stop: once it is set, no further step is made.
        """
        means: dict[str, float] = {}
        if reset and steps:
            self.reset_critic()
        for step in range(steps):
            if stop is not None and stop.is_set():
                break
            for key, value in self.update(1 - step / steps if reset else 1.0, reset).items():
                means[key] = means.get(key, 0.0) + value / steps
        return means

    def state_dict(self) -> dict[str, Any]:
        """All that `update` depends on but the demonstrations, which do not change."""
        return {
            "primitive": self.primitive.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "generator": self.generator.get_state(),
            "rollouts": None if self.rollouts is None else self.rollouts.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.primitive.load_state_dict(state["primitive"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])
        if self.rollouts is not None:
            self.rollouts.load_state_dict(state["rollouts"])


def fit_each(
    learners: Mapping[int, Learner],
    steps: Mapping[int, int],
    reset: bool = False,
    threads: int | None = None,
) -> dict[int, dict[str, float]]:
    """`Learner.fit` of several learners, each by its steps, in threads; None is one a CPU.

    Learners share neither weights nor random generators: the number of threads changes nothing.
    """
    if not learners:
        return {}
    stop = Event()
    with one_thread(), ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        running = {
            number: pool.submit(learner.fit, steps[number], reset, stop)
            for number, learner in learners.items()
        }
        try:
            return {number: future.result() for number, future in running.items()}
        except BaseException:
            stop.set()
            raise


def is_reset_round(done: int, every: int, rounds: int) -> bool:
    """Whether critics are reset after round number `done`, counted from 1: after every so many
    rounds and after the last, but not shortly before it."""
    return done == rounds or (done % every == 0 and rounds - done >= every)


def demonstration_buffer(trials: Sequence[Trials], generator: torch.Generator) -> TrialBuffer:
    """A buffer of trials, a rope an item.

    Args:
        trials: each of one rope.
        generator: of what is sampled.

    Raises:
        ValueError: there are no trials.
    """
    trials = [some for some in trials if len(some)]
    if not trials:
        raise ValueError("there are no demonstrated trials to learn from")
    encoded = encode([some.points[0] for some in trials], [some.action for some in trials])
    splines = [
        encoded.frames[row : row + 1].to_network(some.splines[None])[0]
        for row, some in enumerate(trials)
    ]
    buffer = TrialBuffer(len(trials), max(map(len, trials)), generator)
    buffer.extend(
        encoded.states,
        [torch.from_numpy(one).float() for one in splines],
        [torch.from_numpy(some.success.astype(np.float32)) for some in trials],
    )
    return buffer

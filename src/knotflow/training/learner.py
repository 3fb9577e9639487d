"""One gradient step of adapted QT-Opt on demonstrations and rollouts (Fig. 5, green arrows).

Beyond the paper, critics now and then begin anew. One that learned while its replay buffer filled
has seen the first trials hundreds of times and knows them by heart: on the fresh trials of a
self-play its cross-entropy was 0.42, no better than the mere rate of success, and 0.29 after a
thousand steps from new weights on the same buffer. Nikishin et al., "The Primacy Bias in Deep
Reinforcement Learning" (ICML 2022), found the same cure.
"""

from __future__ import annotations

from threading import Lock
from typing import Any

import numpy as np
import torch
from torch import Tensor

from knotflow.samplers.demonstrations import Trials
from knotflow.samplers.primitives.encoding import Encoded, encode
from knotflow.samplers.primitives.networks import Critic
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.training.augmentation import augment
from knotflow.training.buffer import TransitionBuffer, TrialBuffer, mixed
from knotflow.training.config import LearnerConfig
from knotflow.training.losses import ActorLoss, CriticLoss

_DRAWING = Lock()
"""Learners run side by side, but new weights come from PyTorch's one global generator."""


class Learner:
    """A primitive, its losses and optimiser, and the two replay buffers it learns from."""

    def __init__(self, primitive: Primitive, config: LearnerConfig, seed: int) -> None:
        self.primitive, self.config = primitive, config
        self.generator = torch.Generator().manual_seed(seed)
        self.demonstrations: TrialBuffer | None = None
        self.rollouts: TrialBuffer | TransitionBuffer | None = None
        self.losses: list[CriticLoss | ActorLoss] = []
        if primitive.critic is not None:
            self.losses.append(CriticLoss(primitive.critic))
        if primitive.actor is not None:
            self.losses.append(
                ActorLoss(
                    primitive.actor,
                    config.failure_weight,
                    config.success_share,
                    gains_only=config.gains_only,
                )
            )
        groups = [
            {"params": list(network.parameters()), "boost": boost}
            for network, boost in (
                (primitive.actor, 1.0),
                (primitive.critic, config.settling_boost),
            )
            if network is not None
        ]
        self.optimizer = torch.optim.AdamW(
            groups, config.learning_rate, weight_decay=config.weight_decay
        )

    def restart_critic(self) -> None:
        """Give the critic, if there is one, new weights."""
        critic = self.primitive.critic
        if critic is None:
            return
        seed = int(torch.randint(2**31, (), generator=self.generator))
        with _DRAWING, torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            fresh = Critic(self.primitive.config.network)
        critic.load_state_dict(fresh.state_dict())
        for parameter in critic.parameters():
            self.optimizer.state.pop(parameter, None)

    def update(self, rate: float = 1.0, settling: bool = False) -> dict[str, float]:
        """One gradient step; gives the losses and what goes with them.

        Args:
            rate: share of the learning rate to step with.
            settling: let the critic step as far as one does that begins anew.

        Raises:
            ValueError: there is nothing to learn from.
        """
        config = self.config
        sources = [
            (self.demonstrations, config.demonstration_ropes, config.demonstration_trials,
             config.demonstration_share),
            (self.rollouts, config.rollout_ropes, config.rollout_trials,
             1 - config.demonstration_share),
        ]  # fmt: skip
        filled = [source for source in sources if source[0] is not None and len(source[0])]
        if not filled:
            raise ValueError("a learner needs demonstrations or rollouts before it can update")
        parts = [buffer.sample(ropes, trials) for buffer, ropes, trials, _ in filled if buffer]
        batch = mixed(parts, [share for *_, share in filled])
        batch = augment(batch, config.augmentation, self.generator)
        outcomes = [loss(batch) for loss in self.losses]
        self.optimizer.zero_grad(set_to_none=True)
        total = sum(value for out in outcomes for key, value in out.items() if key[:5] == "loss_")
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.primitive.parameters(), config.gradient_norm)
        for group in self.optimizer.param_groups:
            boost = group["boost"] if settling else 1.0
            group["lr"] = rate * boost * config.learning_rate
        self.optimizer.step()
        return {key: float(value.detach()) for out in outcomes for key, value in out.items()}

    def state_dict(self) -> dict[str, Any]:
        """All that `update` depends on but the demonstrations, which do not change."""
        return {
            "primitive": self.primitive.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "generator": self.generator.get_state(),
            "rollouts": None if self.rollouts is None else self.rollouts.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a `state_dict`."""
        self.primitive.load_state_dict(state["primitive"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])
        if self.rollouts is not None:
            self.rollouts.load_state_dict(state["rollouts"])


def demonstration_buffer(
    trials: list[tuple[Trials, np.ndarray]], generator: torch.Generator
) -> TrialBuffer:
    """A buffer of the trials (of each action, those chosen by a bool (N,)), a start shape an item.

    Raises:
        ValueError: no trial was chosen.
    """
    parts = [grouped(some, chosen) for some, chosen in trials]
    slots = max((len(spline) for _, splines, _ in parts for spline in splines), default=0)
    if slots == 0:
        raise ValueError("there are no demonstrated trials to learn from")
    buffer = TrialBuffer(sum(len(part[1]) for part in parts), slots, generator)
    for encoded, splines, rewards in parts:
        if splines:
            buffer.extend(encoded.states, splines, rewards)
    return buffer


def grouped(trials: Trials, chosen: np.ndarray) -> tuple[Encoded, list[Tensor], list[Tensor]]:
    """Chosen trials by start shape: encoded starts, splines in network space, rewards."""
    kept = np.unique(trials.start[chosen])
    encoded = encode(trials.starts[kept], [trials.action] * len(kept))
    splines, rewards = [], []
    for row, start in enumerate(kept):
        mine = chosen & (trials.start == start)
        network = encoded.frames[row : row + 1].to_network(trials.splines[mine][None])[0]
        splines.append(torch.from_numpy(network).float())
        rewards.append(torch.from_numpy(trials.success[mine].astype(np.float32)))
    return encoded, splines, rewards

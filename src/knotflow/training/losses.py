"""Adapted QT-Opt's two losses (Sec. V-B b, Fig. 5).

Both read a batch of S ropes and N trials; many splines may share a rope, whose trunk runs once:

| key                   | shape          | what                                                |
|-----------------------|----------------|-----------------------------------------------------|
| states                | TensorDict [S] | encoded ropes, see `primitives.encoding`            |
| owner                 | (N,) int64     | the rope of each trial                              |
| spline                | (N, 6)         | in network space                                    |
| reward                | (N,)           | 1 where the trial succeeded, else 0                 |
| baseline              | (N,)           | mean return of the trials known from the same rope  |
| weight                | (N,)           | of the trial in the batch, of mean 1                |
| next_value (optional) | (N,)           | max Q of a next action at the end shape; NaN where  |
|                       |                | none was valued                                     |
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.distributions import MultivariateNormal
from torch.nn.functional import binary_cross_entropy_with_logits

from knotflow.samplers.primitives.networks import Actor, Critic

REACH = 3.0
"""Nats."""


def returns(batch: TensorDict, success_share: float) -> Tensor:
    """Returns (N,) in 0..1: the reward, in part for success and in part for the next value; the
    reward alone where no next value is known."""
    reward: Tensor = batch["reward"]
    if "next_value" not in batch.keys():
        return reward
    next_value = batch["next_value"]
    worth = torch.where(next_value.isnan(), 1.0, success_share + (1 - success_share) * next_value)
    return reward * worth


def critic_loss(critic: Critic, batch: TensorDict) -> dict[str, Tensor]:
    """Cross-entropy between the critic and the outcomes of trials.

    QT-Opt's r + gamma max Q (Sec. V-B c) in two factors: success, learned from every trial, and the
    next value, learned from trials that succeeded and are valued.

    Returns:
        `loss_critic`, and `critic_accuracy`, the share of trials judged rightly.
    """
    reward, weight = batch["reward"], batch["weight"]
    logits = critic(batch["states"], batch["spline"], batch["owner"])
    success, value = logits.unbind(-1)
    loss = binary_cross_entropy_with_logits(success, reward, weight=weight)
    if "next_value" in batch.keys():
        next_value = batch["next_value"]
        known = (reward > 0.5) & ~next_value.isnan()
        weight = torch.where(known, weight, 0.0)
        loss = loss + binary_cross_entropy_with_logits(
            value, torch.where(known, next_value, 0.0), weight=weight
        )
    accuracy = ((success.detach() > 0) == (reward > 0.5)).float().mean()
    return {"loss_critic": loss, "critic_accuracy": accuracy}


def actor_loss(
    actor: Actor,
    batch: TensorDict,
    failure_weight: float = 0.0,
    success_share: float = 0.5,
    gains_only: bool = False,
) -> dict[str, Tensor]:
    """Off-policy REINFORCE, -(R - b) log pi(a | s), with bounded pushes.

    With b = 0 this is reward-weighted maximum likelihood. A failure pushes, and as -log pi has no
    upper bound, one that the actor would not propose any more would go on pushing: it counts only
    where its log density is within `REACH` of the actor's typical one. (Importance weights could
    not be stabilised by the paper's authors either, Sec. VII-B1.)

    Args:
        actor: that learns.
        batch: as above.
        failure_weight: b is this times the batch's baseline.
        success_share: part of the return that is for success alone.
        gains_only: leave out trials below b.

    Returns:
        `loss_actor`, and `actor_spread`, the mean standard deviation, normalised.
    """
    mean, factor = actor(batch["states"])
    owner = batch["owner"]
    gaussian: Any = MultivariateNormal(mean[owner], scale_tril=factor[owner], validate_args=False)
    log_prob = gaussian.log_prob(batch["spline"])
    advantage = returns(batch, success_share) - failure_weight * batch["baseline"]
    if gains_only:
        advantage = advantage.clamp(min=0)
    typical = -gaussian.entropy().detach()  # the mean of log pi under pi
    counts = (advantage > 0) | (log_prob.detach() > typical - REACH)
    pull = batch["weight"] * advantage * counts
    # Per unit of pull, so that the step does not depend on how often the batch succeeds.
    loss = -(pull * log_prob).sum() / pull.abs().sum().clamp(min=1.0)
    spread = factor.detach().square().sum(-1).sqrt().mean()
    return {"loss_actor": loss, "actor_spread": spread}

"""Adapted QT-Opt's two losses (Sec. V-B b, Fig. 5) as TorchRL loss modules.

TorchRL has no QT-Opt, and its ReinforceLoss wants one action a state; here many splines share a
rope, whose trunk runs once. Both read a batch of S ropes and N trials:

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

import torch
from tensordict import TensorDict, TensorDictParams
from torch import Tensor
from torch.distributions import MultivariateNormal
from torch.nn.functional import binary_cross_entropy_with_logits
from torchrl.objectives import LossModule

from knotflow.samplers.primitives.networks import Actor, Critic


def returns(batch: TensorDict, success_share: float) -> Tensor:
    """Returns (N,) in 0..1: the reward, in part for success and in part for the next value; the
    reward alone where no next value is known."""
    if "next_value" not in batch.keys():
        return batch["reward"]
    next_value = batch["next_value"]
    worth = torch.where(next_value.isnan(), 1.0, success_share + (1 - success_share) * next_value)
    return batch["reward"] * worth


class CriticLoss(LossModule):
    """Cross-entropy between the critic and the outcomes of trials.

    QT-Opt's r + gamma max Q (Sec. V-B c) in two factors: success, learned from every trial, and the
    next value, learned from trials that succeeded and are valued.
    """

    critic: Critic
    critic_params: TensorDictParams
    target_critic_params: TensorDictParams

    def __init__(self, critic: Critic) -> None:
        super().__init__()
        self.convert_to_functional(critic, "critic")

    def forward(self, tensordict: TensorDict) -> TensorDict:
        """Gives `loss_critic`, and as `critic_accuracy` the share of trials judged rightly."""
        reward, weight = tensordict["reward"], tensordict["weight"]
        with self.critic_params.to_module(self.critic):
            logits = self.critic(tensordict["states"], tensordict["spline"], tensordict["owner"])
        success, value = logits.unbind(-1)
        loss = binary_cross_entropy_with_logits(success, reward, weight=weight)
        if "next_value" in tensordict.keys():
            next_value = tensordict["next_value"]
            known = (reward > 0.5) & ~next_value.isnan()
            weight = torch.where(known, weight, 0.0)
            loss = loss + binary_cross_entropy_with_logits(
                value, torch.where(known, next_value, 0.0), weight=weight
            )
        accuracy = ((success.detach() > 0) == (reward > 0.5)).float().mean()
        return TensorDict({"loss_critic": loss, "critic_accuracy": accuracy})


class ActorLoss(LossModule):
    """Off-policy REINFORCE, -(R - b) log pi(a | s), with bounded pushes.

    With b = 0 this is reward-weighted maximum likelihood. A failure pushes, and as -log pi has no
    upper bound, one that the actor would not propose any more would go on pushing: it counts only
    where its log density is within `reach` of the actor's typical one. (Importance weights could
    not be stabilised by the paper's authors either, Sec. VII-B1.)
    """

    actor: Actor
    actor_params: TensorDictParams
    target_actor_params: TensorDictParams

    def __init__(
        self,
        actor: Actor,
        failure_weight: float = 0.0,
        success_share: float = 0.5,
        reach: float = 3.0,
        gains_only: bool = False,
    ) -> None:
        """Args:
        actor: that learns.
        failure_weight: b is this times the batch's baseline.
        success_share: part of the return that is for success alone.
        reach: nats.
        gains_only: leave out trials below b.
        """
        super().__init__()
        self.convert_to_functional(actor, "actor")
        self.failure_weight, self.success_share = failure_weight, success_share
        self.gains_only = gains_only
        self.reach = reach

    def forward(self, tensordict: TensorDict) -> TensorDict:
        """Gives `loss_actor`, and as `actor_spread` the mean standard deviation, normalised."""
        with self.actor_params.to_module(self.actor):
            mean, factor = self.actor(tensordict["states"])
        owner, weight = tensordict["owner"], tensordict["weight"]
        gaussian = MultivariateNormal(mean[owner], scale_tril=factor[owner], validate_args=False)
        log_prob = gaussian.log_prob(tensordict["spline"])
        advantage = (
            returns(tensordict, self.success_share) - self.failure_weight * tensordict["baseline"]
        )
        if self.gains_only:
            advantage = advantage.clamp(min=0)
        typical = -gaussian.entropy().detach()  # the mean of log pi under pi
        counts = (advantage > 0) | (log_prob.detach() > typical - self.reach)
        pull = weight * advantage * counts
        # Per unit of pull, so that the step does not depend on how often the batch succeeds.
        loss = -(pull * log_prob).sum() / pull.abs().sum().clamp(min=1.0)
        spread = factor.detach().square().sum(-1).sqrt().mean()
        return TensorDict({"loss_actor": loss, "actor_spread": spread})

"""Adapted QT-Opt's two losses (Sec. V-B b, Fig. 5) as TorchRL loss modules.

TorchRL has no QT-Opt, and its ReinforceLoss wants one action a state and brings a value loss of its
own; here many splines share a rope, whose trunk must run once. Both modules read a batch as
`buffer.TrialBuffer.sample` makes it, with S ropes and N trials:

| key                   | shape          | what                                                |
|-----------------------|----------------|-----------------------------------------------------|
| states                | TensorDict [S] | encoded ropes, see `primitives.encoding`            |
| owner                 | (N,) int64     | the rope of each trial                              |
| spline                | (N, 6)         | in network space                                    |
| reward                | (N,)           | 1 where the trial succeeded, else 0                 |
| baseline              | (N,)           | mean return of the trials known from the same rope  |
| weight                | (N,)           | of the trial in the batch, of mean 1                |
| pull (optional)       | (N,)           | of the trial on the actor; 1 where it is not given  |
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
    """What the actor is to repeat, (N,) in 0..1: the reward, partly for success, partly for what
    is left. Where nothing is known of what comes next it is the reward alone.
    """
    if "next_value" not in batch.keys():
        return batch["reward"]
    next_value = batch["next_value"]
    worth = torch.where(next_value.isnan(), 1.0, success_share + (1 - success_share) * next_value)
    return batch["reward"] * worth


class CriticLoss(LossModule):
    """Cross-entropy between the critic and what trials brought.

    Success is learned from every trial, QT-Opt's r + gamma max Q of what comes next (Sec. V-B c) in
    two factors: what is left onward is learned from trials that succeeded and are valued.
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
        success, onward = logits.unbind(-1)
        loss = binary_cross_entropy_with_logits(success, reward, weight=weight)
        if "next_value" in tensordict.keys():
            next_value = tensordict["next_value"]
            known = (reward > 0.5) & ~next_value.isnan()
            weight = torch.where(known, weight, 0.0)
            loss = loss + binary_cross_entropy_with_logits(
                onward, torch.where(known, next_value, 0.0), weight=weight
            )
        accuracy = ((success.detach() > 0) == (reward > 0.5)).float().mean()
        return TensorDict({"loss_critic": loss, "critic_accuracy": accuracy})


class ActorLoss(LossModule):
    """REINFORCE from the replay buffer: -(R - b) log pi(a | s), kept from running away.

    R is the return: of a step that others follow, how well these can be done from the shape it led
    to, which makes the actor prefer shapes that are favourable (Sec. V-B c).

    The data are not the actor's own. A success pulls the Gaussian towards it and may do so for
    ever: with b = 0 this is reward-weighted maximum likelihood, whose optimum is the Gaussian
    closest to the behaviour's successes. A failure pushes, and as -log pi has no upper bound, a
    failure that the actor would not propose any more would go on pushing. So a failure counts only
    where its density is within `reach` of the actor's typical density. (Importance weights, the
    textbook's cure, could not be stabilised by the paper's authors either, Sec. VII-B1.)
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
        """`failure_weight` times the batch's baseline is b; `success_share` is that part of the
        return which success alone brings; `reach` is in nats; with `gains_only` nothing pushes."""
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
        pull = weight * tensordict.get("pull", torch.ones_like(weight)) * advantage * counts
        # Per unit of pull, so that the step does not depend on how often the batch succeeds.
        loss = -(pull * log_prob).sum() / pull.abs().sum().clamp(min=1.0)
        spread = factor.detach().square().sum(-1).sqrt().mean()
        return TensorDict({"loss_actor": loss, "actor_spread": spread})

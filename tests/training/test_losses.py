from __future__ import annotations

import pytest
import torch
from torch.nn.functional import binary_cross_entropy_with_logits

from knotflow.samplers.primitives import Actor, Critic, NetworkConfig
from knotflow.training.learner import demonstration_buffer
from knotflow.training.losses import actor_loss, critic_loss, returns

NETWORK = NetworkConfig(lstm=8, attention=4, stream=8, feature=8, head=8)


@pytest.fixture
def batch(trials):
    torch.manual_seed(0)
    generator = torch.Generator().manual_seed(0)
    return demonstration_buffer(trials, generator).sample(4, 10)


def test_critic_loss_is_cross_entropy_with_the_reward(batch):
    critic = Critic(NETWORK)
    success, _ = critic(batch["states"], batch["spline"], batch["owner"]).unbind(-1)
    expected = binary_cross_entropy_with_logits(success, batch["reward"])
    torch.testing.assert_close(critic_loss(critic, batch)["loss_critic"], expected)


def test_next_value_is_learned_from_valued_successes(batch):
    critic = Critic(NETWORK)
    alone = critic_loss(critic, batch)["loss_critic"]
    hits = torch.nonzero(batch["reward"] > 0)[:, 0]
    assert len(hits) > 1
    batch["next_value"] = torch.full_like(batch["reward"], 0.8)
    batch["next_value"][hits[0]] = torch.nan
    _, onward = critic(batch["states"], batch["spline"], batch["owner"]).unbind(-1)
    valued = onward[hits[1:]]
    expected = binary_cross_entropy_with_logits(
        valued, torch.full_like(valued, 0.8), reduction="sum"
    ) / len(batch["reward"])
    loss = critic_loss(critic, batch)["loss_critic"]
    torch.testing.assert_close(loss, alone + expected)
    loss.backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in critic.parameters())


def test_returns_weigh_success_and_next_value(batch):
    batch["next_value"] = torch.full_like(batch["reward"], torch.nan)
    assert returns(batch, 0.5).tolist() == batch["reward"].tolist()
    batch["next_value"] = torch.zeros_like(batch["reward"])
    assert returns(batch, 0.25).tolist() == (0.25 * batch["reward"]).tolist()
    assert returns(batch, 0.0).sum() == 0
    batch["next_value"] = torch.ones_like(batch["reward"])
    assert returns(batch, 0.25).tolist() == batch["reward"].tolist()


def test_actor_loss_without_baseline_is_likelihood_of_successes(batch):
    actor = Actor(NETWORK)
    mean, factor = actor(batch["states"])
    log_prob = torch.stack(
        [
            torch.distributions.MultivariateNormal(
                mean[owner], factor[owner] @ factor[owner].T
            ).log_prob(spline)
            for owner, spline in zip(batch["owner"], batch["spline"], strict=True)
        ]
    )
    expected = -log_prob[batch["reward"] > 0].mean()
    loss = actor_loss(actor, batch)["loss_actor"]
    torch.testing.assert_close(loss, expected, atol=1e-4, rtol=1e-4)


def test_failures_count_only_within_reach_of_the_actor(batch):
    actor = Actor(NETWORK)
    batch["reward"] = torch.zeros_like(batch["reward"])
    batch["baseline"] = torch.full_like(batch["baseline"], 0.5)
    near = batch.clone()
    near["spline"] = actor(batch["states"])[0].detach()[batch["owner"]]
    far = batch.clone()
    far["spline"] = near["spline"] + 100

    def gradient(some):
        actor.zero_grad()
        actor_loss(actor, some, failure_weight=1.0)["loss_actor"].backward()
        return sum(float(p.grad.abs().sum()) for p in actor.parameters())

    assert gradient(near) > 0
    assert gradient(far) == 0
    assert actor_loss(actor, near, failure_weight=0.0)["loss_actor"] == 0


def test_gains_only_leaves_out_trials_below_the_baseline(batch):
    actor = Actor(NETWORK)
    batch["baseline"] = torch.full_like(batch["baseline"], 2.0)
    pushed = actor_loss(actor, batch, failure_weight=1.0)["loss_actor"]
    assert pushed != 0
    assert actor_loss(actor, batch, failure_weight=1.0, gains_only=True)["loss_actor"] == 0

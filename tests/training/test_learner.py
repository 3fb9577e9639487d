"""Losses, gradient steps, and resets of the critic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch.nn.functional import binary_cross_entropy_with_logits

from knotflow.samplers.primitives import Actor, Critic, NetworkConfig, Primitive, encode
from knotflow.threads import one_thread
from knotflow.topology import parse_action
from knotflow.training import LearnerConfig
from knotflow.training.buffers import TransitionBuffer
from knotflow.training.config import ExplorationConfig
from knotflow.training.learner import (
    POLICY,
    Learner,
    actor_loss,
    critic_loss,
    demonstration_buffer,
    explore,
    fit_each,
    is_reset_round,
    returns,
)
from knotflow.training.trainer import Trainer, run_training

NETWORK = NetworkConfig(lstm=8, attention=4, stream=8, feature=8, head=8)
R1 = parse_action("R1(0,1,1)")
CONFIG = LearnerConfig(learning_rate=1e-3, critic_reset_boost=3.0, demonstration_trials=4)


@pytest.fixture
def make(primitive_config, trials):
    def learner(seed=3, variant="actor_critic"):
        torch.manual_seed(0)
        one = Learner(Primitive(replace(primitive_config, variant=variant)), CONFIG, seed)
        one.demonstrations = demonstration_buffer(trials, one.generator)
        return one

    return learner


def weights(network):
    return torch.cat([value.flatten() for value in network.state_dict().values()])


def test_reset_forgets_the_critic_and_keeps_the_actor(make):
    one, other = make(), make()
    actor = weights(one.primitive.actor)
    other.fit(3)
    for learner in (one, other):
        learner.generator.manual_seed(7)
        learner.reset_critic()
    assert torch.equal(weights(one.primitive.critic), weights(other.primitive.critic))
    assert torch.equal(weights(one.primitive.actor), actor)
    known = {id(parameter) for parameter in other.optimizer.state}
    assert not known & {id(parameter) for parameter in other.primitive.critic.parameters()}
    assert known >= {id(parameter) for parameter in other.primitive.actor.parameters()}


def test_new_weights_leave_the_global_generator_alone(make):
    learner = make()
    torch.manual_seed(1)
    learner.reset_critic()
    drawn = torch.rand(3)
    torch.manual_seed(1)
    assert torch.equal(drawn, torch.rand(3))


def test_learning_rate_falls_after_reset_and_is_boosted_for_the_critic(make):
    learner = make()
    rates = []
    update = learner.update

    def watched(*arguments):
        losses = update(*arguments)
        rates.append([group["lr"] for group in learner.optimizer.param_groups])
        return losses

    learner.update = watched
    learner.fit(1)
    learner.fit(2, reset=True)
    assert rates == [[1e-3, 1e-3], [1e-3, 3e-3], [0.5e-3, 1.5e-3]]


def test_learners_in_threads_learn_as_one_by_one(make):
    alone, beside = {n: make(n) for n in (1, 2, 3)}, {n: make(n) for n in (1, 2, 3)}
    with one_thread():
        for learner in alone.values():
            learner.fit(2, reset=True)
    fit_each(beside, dict.fromkeys(beside, 2), reset=True)
    for number, learner in alone.items():
        assert torch.equal(weights(learner.primitive), weights(beside[number].primitive))


def test_actor_without_critic_learns_after_reset(make):
    learner = make(variant="actor_only")
    before = weights(learner.primitive)
    assert "loss_actor" in learner.fit(2, reset=True)
    assert not torch.equal(weights(learner.primitive), before)


@pytest.mark.parametrize(
    ("every", "rounds", "after"),
    [(20, 40, [20, 40]), (20, 45, [20, 45]), (20, 24, [24]), (50, 3, [3]), (1, 3, [1, 2, 3])],
)
def test_reset_rounds(every, rounds, after):
    assert [done for done in range(1, rounds + 1) if is_reset_round(done, every, rounds)] == after


class SmallMemory(Trainer):
    """Two gradient steps a round, on a replay buffer of 5 to which every round adds 3."""

    def __init__(self, learner, curves):
        super().__init__(rounds=6)
        self.learner, self.curves = learner, curves
        learner.demonstrations = None
        learner.rollouts = TransitionBuffer(5, learner.generator)

    def step(self):
        states = encode(self.curves[:3], [R1] * 3).states
        random = torch.rand(3, 9, generator=self.learner.generator)
        self.learner.rollouts.extend(
            TensorDict(
                {
                    "states": states,
                    "next_states": states,
                    "next_primitive": torch.full((3,), -1),
                    "spline": random[:, :6],
                    "reward": random[:, 6].round(),
                    "baseline": random[:, 7],
                    "next_value": random[:, 8],
                },
                batch_size=[3],
            )
        )
        return self.learner.fit(2)

    @property
    def parts(self):
        return {"learner": self.learner.parts}


@pytest.mark.parametrize(
    "rounds", [2, *(pytest.param(rounds, marks=pytest.mark.slow) for rounds in (1, 3, 4))]
)
def test_training_resumed_with_full_replay_buffer_ends_the_same(
    make, curves, tmp_path, interrupted_training, rounds
):
    whole, resumed = SmallMemory(make(), curves), SmallMemory(make(), curves)
    list(whole)
    with interrupted_training(rounds):
        run_training(SmallMemory(make(), curves), tmp_path, name="interrupted")
    run_training(resumed, tmp_path, name="resumed")
    assert resumed.history == whole.history
    assert torch.equal(weights(resumed.learner.primitive), weights(whole.learner.primitive))


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
    policy = actor(batch["states"])
    mean, factor = policy.mean, policy.factor
    log_prob = torch.stack(
        [
            torch.distributions.MultivariateNormal(
                mean[owner], factor[owner] @ factor[owner].T
            ).log_prob(spline)
            for owner, spline in zip(batch["owner"], batch["spline"], strict=True)
        ]
    )
    expected = -log_prob[batch["reward"] > 0].mean()
    loss = actor_loss(actor, batch, LearnerConfig())["loss_actor"]
    torch.testing.assert_close(loss, expected, atol=1e-4, rtol=1e-4)


def test_failures_count_only_within_reach_of_the_actor(batch):
    actor = Actor(NETWORK)
    batch["reward"] = torch.zeros_like(batch["reward"])
    batch["baseline"] = torch.full_like(batch["baseline"], 0.5)
    near = batch.clone()
    near["spline"] = actor(batch["states"]).mean.detach()[batch["owner"]]
    far = batch.clone()
    far["spline"] = near["spline"] + 100

    def gradient(some):
        actor.zero_grad()
        actor_loss(actor, some, LearnerConfig(failure_weight=1.0))["loss_actor"].backward()
        return sum(float(p.grad.abs().sum()) for p in actor.parameters())

    assert gradient(near) > 0
    assert gradient(far) == 0
    assert actor_loss(actor, near, LearnerConfig(failure_weight=0.0))["loss_actor"] == 0


def test_gains_only_leaves_out_trials_below_the_baseline(batch):
    actor = Actor(NETWORK)
    batch["baseline"] = torch.full_like(batch["baseline"], 2.0)
    pushed, gains = (LearnerConfig(failure_weight=1.0, gains_only=one) for one in (False, True))
    assert actor_loss(actor, batch, pushed)["loss_actor"] != 0
    assert actor_loss(actor, batch, gains)["loss_actor"] == 0


def test_shares_of_exploration_may_add_up_to_all(primitive_config, curves):
    encoded = encode(curves, [R1] * len(curves))
    config = ExplorationConfig(search=0.9, spread=0.1, population=8)
    rng = np.random.default_rng(0)
    splines, ways = explore(Primitive(primitive_config), encoded, 2, config, 0.0, rng)
    assert splines.shape == (len(curves), 2, 6) and POLICY not in ways

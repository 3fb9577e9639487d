"""Gradient steps, and resets of the critic."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from knotflow.samplers.primitives import Primitive, encode
from knotflow.topology import parse_action
from knotflow.training import LearnerConfig
from knotflow.training.buffers import TransitionBuffer
from knotflow.training.learner import Learner, demonstration_buffer, fit_each, is_reset_round
from knotflow.training.trainer import Trainer, run_training

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
    for learner in alone.values():
        learner.fit(2, reset=True)
    fit_each(beside, dict.fromkeys(beside, 2), reset=True, threads=3)
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

    def state_dict(self):
        return super().state_dict() | {"learner": self.learner.state_dict()}

    def load_state_dict(self, state):
        super().load_state_dict(state)
        self.learner.load_state_dict(state["learner"])


@pytest.mark.parametrize("rounds", [1, 2, 3, 4])
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

"""The optimiser, and critics that begin anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import Primitive
from knotflow.training import LearnerConfig
from knotflow.training.fitting import fit, fit_each, settles
from knotflow.training.learner import Learner, demonstration_buffer

CONFIG = LearnerConfig(learning_rate=1e-3, settling_boost=3.0, demonstration_trials=4)


@pytest.fixture
def make(primitive_config, trials):
    def learner(seed=3, variant="actor_critic"):
        torch.manual_seed(0)
        one = Learner(Primitive(replace(primitive_config, variant=variant)), CONFIG, seed)
        one.demonstrations = demonstration_buffer(
            [(trials, np.ones(len(trials), bool))], one.generator
        )
        return one

    return learner


def weights(network):
    return torch.cat([value.flatten() for value in network.state_dict().values()])


def test_a_critic_that_begins_anew_has_forgotten_all_and_the_actor_nothing(make):
    one, other = make(), make()
    actor = weights(one.primitive.actor)
    fit(other, 3)
    for learner in (one, other):
        learner.generator.manual_seed(7)
        learner.restart_critic()
    assert torch.equal(weights(one.primitive.critic), weights(other.primitive.critic))
    assert torch.equal(weights(one.primitive.actor), actor)
    known = {id(parameter) for parameter in other.optimizer.state}
    assert not known & {id(parameter) for parameter in other.primitive.critic.parameters()}
    assert known >= {id(parameter) for parameter in other.primitive.actor.parameters()}


def test_new_weights_leave_the_global_generator_alone(make):
    learner = make()
    torch.manual_seed(1)
    learner.restart_critic()
    drawn = torch.rand(3)
    torch.manual_seed(1)
    assert torch.equal(drawn, torch.rand(3))


def test_only_a_settling_critic_steps_farther_and_ever_less(make):
    learner = make()
    rates = []
    update = learner.update

    def watched(*arguments):
        losses = update(*arguments)
        rates.append([group["lr"] for group in learner.optimizer.param_groups])
        return losses

    learner.update = watched
    fit(learner, 1)
    fit(learner, 2, settling=True)
    assert rates == [[1e-3, 1e-3], [1e-3, 3e-3], [0.5e-3, 1.5e-3]]


def test_side_by_side_learners_settle_as_one_by_one(make):
    alone, beside = {n: make(n) for n in (1, 2, 3)}, {n: make(n) for n in (1, 2, 3)}
    for learner in alone.values():
        fit(learner, 2, settling=True)
    fit_each(beside, 2, settling=True, threads=3)
    for number, learner in alone.items():
        assert torch.equal(weights(learner.primitive), weights(beside[number].primitive))


def test_an_actor_without_critic_settles_too(make):
    learner = make(variant="actor_only")
    before = weights(learner.primitive)
    assert "loss_actor" in fit(learner, 2, settling=True)
    assert not torch.equal(weights(learner.primitive), before)


@pytest.mark.parametrize(
    ("every", "rounds", "after"),
    [(20, 40, [20, 40]), (20, 45, [20, 45]), (20, 24, [24]), (50, 3, [3]), (1, 3, [1, 2, 3])],
)
def test_learners_settle_now_and_then_and_at_the_end(every, rounds, after):
    assert [done for done in range(1, rounds + 1) if settles(done, every, rounds)] == after

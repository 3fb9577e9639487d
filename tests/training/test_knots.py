"""Finetuning on knots with networks so small that they learn little, as its laws allow."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives.canonical import ARRANGE
from knotflow.simulation import WorldsConfig
from knotflow.topology import knot
from knotflow.training import KnotFinetuning, KnotsConfig, LearnerConfig

CONFIG = KnotsConfig(
    LearnerConfig(rollout_ropes=16, rollout_trials=1),
    rounds=2, environments=4, splines=3, steps=1, new_steps=1, successes_per_step=1,
    capacity=200, refreshed=8, ropes=3,
)  # fmt: skip


@pytest.fixture
def training(completed_training):
    return completed_training(KnotFinetuning, CONFIG)


def test_episodes_have_goals_and_ropes_in_the_shares_asked_for(training):
    some = training(knots={"overhand": 2.0}, crossings_shares=[0.0, 0.0, 1.0, 1.0])
    begun = [some.begin() for _ in range(400)]
    crossings = Counter(min(goal.num_crossings for goal in one.task.goals) for one in begun)
    overhands = sum(one.task.goals == knot("overhand") for one in begun)
    assert overhands == pytest.approx(200, abs=40)
    assert crossings[2] == pytest.approx(100, abs=35) and crossings[3] >= overhands
    ropes = Counter(some.ropes.index(one.rope) for one in begun)
    assert ropes[0] == pytest.approx(400 * (0.4 + 0.6 / 3), abs=40) and len(ropes) == 3
    assert all(one.state in one.task.actions for one in begun)


def test_all_but_the_arranging_primitive_learn_and_the_library_is_of_many_ropes(training):
    some = training()
    assert some.buffers.keys() == set(some.library.primitives) - {ARRANGE}
    assert some.library.proportions == CONFIG.proportions
    assert training(ropes=1).library.proportions is None


def test_steps_are_simulated_each_in_a_world_of_its_own(training, laid):
    simulator = laid()
    seen = []

    def execute(points, splines, worlds=None, controls=None):
        seen.extend(worlds)
        return execute.of(points, splines, worlds, controls)

    execute.of, simulator.execute = simulator.execute, execute
    some = training(simulator, ropes=1, worlds=WorldsConfig(level=2, error=0.01))
    some.collect()
    assert len({world.pace for world in seen}) == len(seen) >= CONFIG.environments
    assert np.std([world.grasp for world in seen]) > 0


def test_critics_are_never_reset(training, monkeypatch):
    monkeypatch.setattr(
        "knotflow.training.transitions.fit_each",
        lambda ready, most, reset: {number: {} for number in ready} if not reset else 1 / 0,
    )
    assert len(list(training())) == CONFIG.rounds


@pytest.mark.slow
def test_interrupted_training_ends_the_same(whole_and_resumed, weights):
    whole, resumed = whole_and_resumed
    assert whole.history == resumed.history
    torch.testing.assert_close(weights(resumed), weights(whole), atol=0, rtol=0)

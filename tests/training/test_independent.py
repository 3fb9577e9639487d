from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.samplers.demonstrations import task
from knotflow.samplers.primitives import Primitive, encode
from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    resample,
    state_or_none,
)
from knotflow.topology.draw import draw
from knotflow.training import (
    Imitation,
    ImitationConfig,
    LearnerConfig,
    Reinforcement,
    ReinforcementConfig,
)
from knotflow.training.config import AugmentationConfig

IMITATION = ImitationConfig(
    LearnerConfig(learning_rate=5e-3, augmentation=AugmentationConfig(0.0, 0.0)),
    steps=10,
    validations=6,
)
TASK = task("R1(0,1,1)")
CONFIG = ReinforcementConfig(
    LearnerConfig(demonstration_trials=4, rollout_ropes=4),
    rounds=[3, 3, 3, 3],
    room=[0.0, 0.0, 0.0, 0.0],
    ropes=3,
    splines=2,
    steps=2,
    critic_reset_steps=2,
)


@pytest.fixture(scope="module")
def simulator():
    return RopeSimulator(
        SimulationConfig(rope=RopeConfig(), pace=2.0, ramp_time=0.1, settle_time=0.1)
    )


@pytest.fixture
def start(primitive_config, trials, curves, simulator):
    def make(config=CONFIG, variant="actor_critic", observe=None, simulator=simulator):
        torch.manual_seed(0)
        primitive = Primitive(replace(primitive_config, variant=variant))
        pools = {TASK: curves}
        return Reinforcement(primitive, trials, pools, simulator, config, 5, observe=observe)

    return make


def weights(training):
    return torch.cat([value.flatten() for value in training.primitive.state_dict().values()])


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["actor_critic", "actor_only", "critic_only"])
def test_a_round_gives_all_it_simulated_and_trains(start, curves, variant):
    rounds = {}
    training = start(variant=variant, observe=rounds.__setitem__)
    before = weights(training)
    metrics = list(training)
    assert list(rounds) == [one["step"] for one in metrics] == [0, 1, 2]
    (attempts,) = rounds[0]
    assert (attempts.action, attempts.start) == (TASK.action, TASK.start_state)
    assert attempts.splines.shape == (6, 6) and len(attempts.rollouts) == 6
    assert (attempts.splines >= SPLINE_LOW).all() and (attempts.splines <= SPLINE_HIGH).all()
    assert all((curves == points).all((1, 2)).any() for points in attempts.points)
    left = [
        end
        for end, state in zip(attempts.rollouts.end_points, attempts.ends, strict=True)
        if state == TASK.start_state
    ]
    known = [*curves, *left]  # only round 1 can start from what round 0 left
    assert left
    for points in rounds[1][0].points:
        assert any(np.array_equal(points, shape) for shape in known)
    goal = TASK.goal_state
    ends = [state_or_none(end) == goal for end in attempts.rollouts.end_points]
    np.testing.assert_array_equal(attempts.success, ends & ~attempts.rollouts.diverged)
    assert np.isfinite(list(metrics[-1].values())).all()
    assert not torch.equal(weights(training), before)


def test_what_was_tried_is_what_is_remembered(start, curves):
    rounds = {}
    training = start(observe=rounds.__setitem__)
    next(iter(training))
    (attempts,) = rounds[0]
    buffer = training.rollouts
    items = buffer.state_dict()["items"]
    assert items["count"].sum() == len(attempts.splines)
    frames = encode(attempts.points[::2], [TASK.action] * 3).frames
    expected = frames.to_network(attempts.splines.reshape(3, 2, 6))
    np.testing.assert_allclose(items["spline"].numpy(), expected, atol=1e-5)
    np.testing.assert_array_equal(items["reward"].numpy().ravel(), attempts.success)


def test_trials_of_other_primitives_are_left_out(primitive_config, trials, curves, simulator):
    loop = resample(draw(TASK.goal_state), RopeConfig())
    others = [
        replace(trials[0], start=task(name).start_state, action=task(name).action, points=points)
        for name, points in (("R2(0,0,1,1)", trials[0].points), ("C(0,1,1)", loop[None]))
    ]
    pools = {TASK: curves}
    primitive = Primitive(primitive_config)
    some = Reinforcement(primitive, [*trials, *others], pools, simulator, CONFIG, 5)
    assert len(some.learner.demonstrations) == len(trials)


@pytest.mark.parametrize(("room", "rewarded"), [(0.1, 1.0), (0.4, 0.0)])
def test_an_end_without_room_is_no_reward(start, laid, room, rewarded):
    loop = resample(draw(TASK.goal_state), RopeConfig())
    some = start(replace(CONFIG, room=[room] * 4), simulator=laid(loop))
    metrics = next(iter(some))
    assert metrics["policy_success/R1(0,1,1)"] == 1.0
    assert (some.rollouts.state_dict()["items"]["reward"] == rewarded).all()


@pytest.mark.slow
def test_an_interrupted_reinforcement_ends_with_the_same_weights(start, tmp_path):
    through = start()
    list(through)
    first = start()
    next(iter(first))
    first.save(tmp_path / "checkpoint")
    second = start()
    second.load(tmp_path / "checkpoint")
    assert [one["step"] for one in second] == [1, 2]
    torch.testing.assert_close(weights(second), weights(through), atol=0, rtol=0)


@pytest.mark.slow
def test_imitation_learns_what_makes_trials_succeed(primitive_config, trials, curves):
    training = Imitation([trials], primitive_config, replace(IMITATION, validations=12), 0)
    metrics = list(training)
    assert metrics[-1]["loss_critic"] < 0.6 * metrics[0]["loss_critic"]
    seen = encode(curves, [one.action for one in trials])
    found = training.primitive.search(seen, 8, np.random.default_rng(1))
    rate = (found[..., 5] > 0.2).float().mean()
    assert rate > 0.8 > np.mean([one.success for one in trials]) + 0.2


def test_trials_of_every_start_are_learned_from(primitive_config, trials):
    training = Imitation([trials], primitive_config, IMITATION, 0)
    learned = training.learner.demonstrations.state_dict()["items"]["count"].sum()
    assert len(training.learner.demonstrations) == len(trials)
    assert learned == sum(map(len, trials)) - round(IMITATION.held_out * sum(map(len, trials)))


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["actor_only", "critic_only"])
def test_a_variant_trains_the_network_it_has(primitive_config, trials, variant):
    training = Imitation([trials], replace(primitive_config, variant=variant), IMITATION, 0)
    name = variant.removesuffix("_only")
    metrics = list(training)
    assert metrics[-1][f"validation_loss_{name}"] < metrics[0][f"validation_loss_{name}"]


@pytest.mark.slow
def test_an_interrupted_imitation_ends_with_the_same_weights(primitive_config, trials, tmp_path):
    short = replace(IMITATION, steps=2, validations=3)
    through, first, second = (Imitation([trials], primitive_config, short, 3) for _ in range(3))
    list(through)
    next(iter(first))
    first.save(tmp_path / "checkpoint")
    second.load(tmp_path / "checkpoint")
    assert len(list(second)) == 2
    torch.testing.assert_close(weights(second), weights(through), atol=0, rtol=0)

"""The environments keep their interfaces' contracts and the rules of the game."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from torchrl.envs.utils import check_env_specs

from knotflow.apps.tasks import (
    ENV_ID,
    BatchedTieEnv,
    TieEnv,
    TieTask,
    register_envs,
    to_box,
    to_splines,
)
from knotflow.samplers.demonstrations import aim
from knotflow.simulation import SimulationConfig, arc, straight
from knotflow.topology import parse_action

NOTHING = to_box(np.array([0.5, 0.0, 0.0, 0.02, 0.0, 0.0]))


@pytest.fixture(scope="module")
def rope():
    return straight(SimulationConfig().rope)


@pytest.fixture(scope="module")
def loop(rope):
    """An environment that asks for R1(0,1,1) in a straight rope."""
    return TieEnv(TieTask.single("R1(0,1,1)", rope[None]))


@pytest.mark.slow
def test_gymnasiums_checker_is_content():
    register_envs()
    env = gymnasium.make(ENV_ID, task="overhand", render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.slow
def test_torchrls_checker_is_content():
    check_env_specs(BatchedTieEnv("overhand", batch=2))


def test_an_action_that_is_done_is_rewarded_and_ends_the_episode(loop, rope):
    action = parse_action("R1(0,1,1)")
    rewards = []
    for seed in range(6):
        observation, info = loop.reset(seed=seed)
        assert info["state"] == "trivial" and info["actions"] == ("R1(0,1,1)",)
        spline = aim(rope, action, 1, np.random.default_rng(seed))[0]
        observation, reward, terminated, truncated, info = loop.step(to_box(spline))
        assert reward == info["is_success"] == (info["state"] == "2o1+")
        assert terminated or truncated, "a single action has one spline"
        assert terminated == (info["state"] != "trivial")
        rewards.append(reward)
    assert max(rewards) == 1


def test_an_episode_goes_on_along_the_dag_until_its_splines_are_used_up(rope):
    env = TieEnv(TieTask.tie("overhand", rope[None], splines=2))
    env.reset(options={"start": 0})
    _, reward, terminated, truncated, info = env.step(NOTHING)
    assert (reward, terminated, truncated) == (0, False, False)
    assert info["state"] == "trivial" and all(a[:2] in ("R1", "R2", "C(") for a in info["actions"])
    assert env.step(NOTHING)[2:4] == (False, True)


def test_the_batch_plays_like_the_single_rope():
    config = SimulationConfig().rope
    task = TieTask.single("R1(0,1,1)", np.stack([straight(config), arc(config)]))
    action = np.float32([[0.9, 0.1, -0.3, 0.2, 0.4, 0.5], [-0.9, 0.2, 0.1, -0.3, -0.2, 0.1]])
    env, batched = TieEnv(task), BatchedTieEnv(task, batch=2, seed=3)
    first = batched.reset()
    after = batched.step(first.set("action", torch.from_numpy(action)))["next"]
    for row in range(2):
        starts = task.starts.astype(np.float32)
        index = int(np.flatnonzero((starts == first["points"][row].numpy()).all((1, 2)))[0])
        env.reset(options={"start": index})
        observation, reward, terminated, truncated, _ = env.step(action[row])
        np.testing.assert_allclose(observation["points"], after["points"][row], atol=1e-6)
        assert [reward, terminated, truncated] == [
            float(after[key][row]) for key in ("reward", "terminated", "truncated")
        ]


def test_only_the_ropes_that_are_asked_for_are_reset():
    env = BatchedTieEnv("overhand", batch=2)
    first = env.reset()
    before = env.episodes.points.copy()
    again = env.reset(first.set("_reset", torch.tensor([[True], [False]])))
    kept = (env.episodes.points == before).all((1, 2))
    assert kept.tolist() == [False, True]
    np.testing.assert_array_equal(again["points"], env.episodes.points.astype(np.float32))


def test_the_box_holds_every_spline(rng):
    box = rng.uniform(-1, 1, (20, 6))
    np.testing.assert_allclose(to_box(to_splines(box)), box, atol=1e-6)
    assert (to_splines(box * 3) == to_splines(np.clip(box * 3, -1, 1))).all()


def test_wrong_input_is_named(rope):
    with pytest.raises(ValueError, match="choose None or rgb_array"):
        TieEnv(render_mode="human")
    with pytest.raises(ValueError, match="there is: start"):
        TieEnv().reset(options={"rope": 1})
    with pytest.raises(ValueError, match="draws random curves"):
        TieEnv().reset(options={"start": 0})
    with pytest.raises(ValueError, match="at least 1 rope"):
        BatchedTieEnv(batch=0)

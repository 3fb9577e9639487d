"""The environment keeps its interface's contract and the rules of the game."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from knotflow.apps.tasks import (
    ENV_ID,
    TieEnv,
    TieTask,
    register_envs,
    to_box,
    to_splines,
)
from knotflow.samplers.demonstrations import heuristic_splines
from knotflow.simulation import SimulationConfig, straight
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
def test_gymnasium_checker_accepts_env():
    register_envs()
    env = gymnasium.make(ENV_ID, task="overhand", render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_reached_state_is_rewarded_and_ends_episode(loop, rope):
    action = parse_action("R1(0,1,1)")
    rewards = []
    for seed in range(6):
        _, info = loop.reset(seed=seed)
        assert info["state"] == "trivial" and info["actions"] == ("R1(0,1,1)",)
        spline = heuristic_splines(rope, action, 1, np.random.default_rng(seed))[0]
        _, reward, terminated, truncated, info = loop.step(to_box(spline))
        assert reward == info["is_success"] == (info["state"] == "2o1+")
        assert terminated or truncated, "a single action has one spline"
        assert terminated == (info["state"] != "trivial")
        rewards.append(reward)
    assert max(rewards) == 1


def test_episode_continues_until_splines_are_used_up(rope):
    env = TieEnv(TieTask.tie("overhand", rope[None], splines=2))
    env.reset(options={"start": 0})
    _, reward, terminated, truncated, info = env.step(NOTHING)
    assert (reward, terminated, truncated) == (0, False, False)
    assert info["state"] == "trivial" and all(a[:2] in ("R1", "R2", "C(") for a in info["actions"])
    assert env.step(NOTHING)[2:4] == (False, True)


def test_step_executes_the_spline_of_its_box(loop):
    box = to_box(np.array([0.1, 0.2, 0.1, 0.1, -0.2, 0.1]))
    ends = []
    for execute, given in ((loop.execute, to_splines(box)), (loop.step, box)):
        loop.reset(seed=0)
        ends.append(execute(given)[0]["points"])
    np.testing.assert_array_equal(*ends)


@pytest.mark.slow
def test_make_vec_makes_many():
    register_envs()
    env = gymnasium.make_vec(ENV_ID, num_envs=2)
    observation, _ = env.reset(seed=0)
    assert observation["points"].shape == (2, 41, 3)
    assert not np.array_equal(*observation["points"])
    assert env.step(np.stack([NOTHING, NOTHING]))[1].tolist() == [0, 0]


def test_box_holds_every_spline(rng):
    box = rng.uniform(-1, 1, (20, 6))
    np.testing.assert_allclose(to_box(to_splines(box)), box, atol=1e-6)
    assert (to_splines(box * 3) == to_splines(np.clip(box * 3, -1, 1))).all()


def test_wrong_arguments_are_named(rope):
    with pytest.raises(ValueError, match="choose None or rgb_array"):
        TieEnv(render_mode="human")
    with pytest.raises(ValueError, match="there is: start"):
        TieEnv().reset(options={"rope": 1})
    with pytest.raises(ValueError, match="the task has 0 starts"):
        TieEnv().reset(options={"start": 0})

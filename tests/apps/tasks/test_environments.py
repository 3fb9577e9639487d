"""The environments keep their interfaces' contracts and the rules of the game."""

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
    TieVectorEnv,
    register_envs,
    to_box,
    to_splines,
)
from knotflow.samplers.demonstrations import heuristic_splines
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


def test_vector_env_matches_single_env():
    config = SimulationConfig().rope
    task = TieTask.single("R1(0,1,1)", np.stack([straight(config), arc(config)]))
    actions = np.float32([[0.9, 0.1, -0.3, 0.2, 0.4, 0.5], [-0.9, 0.2, 0.1, -0.3, -0.2, 0.1]])
    env, vector = TieEnv(task), TieVectorEnv(2, task)
    first, _ = vector.reset(seed=3)
    observations, rewards, terminated, truncated, infos = vector.step(actions)
    assert observations in vector.observation_space and first in vector.observation_space
    for row in range(2):
        starts = task.starts.astype(np.float32)
        index = int(np.flatnonzero((starts == first["points"][row]).all((1, 2)))[0])
        env.reset(options={"start": index})
        observation, reward, *ended, info = env.step(actions[row])
        np.testing.assert_allclose(observation["points"], observations["points"][row], atol=1e-6)
        assert [reward, *ended] == [rewards[row], terminated[row], truncated[row]]
        assert info == {name: values[row] for name, values in infos.items()}


def test_vector_env_resets_ended_episodes_in_the_next_step(rope):
    vector = TieVectorEnv(2, TieTask.tie("overhand", rope[None], splines=2))
    before, _ = vector.reset(seed=0)
    vector.episodes.used[0] = 1  # so that only the first episode ends
    *_, truncated, _ = vector.step(np.stack([NOTHING, NOTHING]))
    assert truncated.tolist() == [True, False]
    action = to_box(np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.2]))
    after, rewards, terminated, truncated, _ = vector.step(np.stack([action, action]))
    assert truncated.tolist() == [False, True] and not terminated[0] and not rewards[0]
    laid_anew = (after["points"] == before["points"]).all((1, 2))
    assert laid_anew.tolist() == [True, False]
    assert vector.episodes.used[0] == 0


@pytest.mark.slow
def test_make_vec_makes_the_vector_env():
    register_envs()
    env = gymnasium.make_vec(ENV_ID, num_envs=2, vectorization_mode="vector_entry_point")
    assert isinstance(env.unwrapped, TieVectorEnv)
    assert env.reset(seed=0)[0]["points"].shape[0] == 2


def test_box_holds_every_spline(rng):
    box = rng.uniform(-1, 1, (20, 6))
    np.testing.assert_allclose(to_box(to_splines(box)), box, atol=1e-6)
    assert (to_splines(box * 3) == to_splines(np.clip(box * 3, -1, 1))).all()


def test_wrong_arguments_are_named(rope):
    with pytest.raises(ValueError, match="choose None or rgb_array"):
        TieEnv(render_mode="human")
    with pytest.raises(ValueError, match="there is: start"):
        TieEnv().reset(options={"rope": 1})
    with pytest.raises(ValueError, match="draws random curves"):
        TieEnv().reset(options={"start": 0})
    with pytest.raises(ValueError, match="at least 1 rope"):
        TieVectorEnv(0)

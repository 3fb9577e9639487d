"""Joint finetuning with networks so small that they learn little; its laws do not depend on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives.canonical import canonicalise
from knotflow.simulation import Attempts, RopeConfig, resample, straight
from knotflow.topology import TopologicalState, knot, parse_action
from knotflow.topology.draw import draw
from knotflow.training import JointConfig, JointFinetuning, LearnerConfig
from knotflow.training.transitions import Query, Transition

CONFIG = JointConfig(
    LearnerConfig(rollout_ropes=16, rollout_trials=1),
    rounds=2, environments=4, splines=3, steps=1, new_steps=1, successes_per_step=1,
    critic_reset_steps=1, capacity=200, refreshed=8,
)  # fmt: skip
ROPE = RopeConfig()
TRIVIAL = TopologicalState.trivial()
LOOP, TWO = TopologicalState.parse("2o1+"), TopologicalState.parse("1o3+4o2+")
BESIDE = TRIVIAL.apply(parse_action("R2(0,0,1,1)"))
"""Of no overhand's DAG."""


@pytest.fixture
def training(make_library, laid):
    def make(simulator=None, earlier=(), **changes):
        config = replace(CONFIG, **changes)
        return JointFinetuning(make_library(), {}, earlier, simulator or laid(), config, 7)

    return make


def shape(state):
    return straight(ROPE) if state == TRIVIAL else resample(draw(state), ROPE)


def moved(start, action, end):
    action = parse_action(action)
    query = Query(shape(start), start, action, canonicalise(shape(start), action))
    return Transition(query, np.full(6, 0.1), shape(end), end)


@pytest.mark.parametrize(
    ("end", "shortest", "splines", "tied"),
    [
        (None, 0.0, 3, 0.0),  # stays as it is: goes on
        (LOOP, 0.0, 3, 0.0),  # on the DAG
        (LOOP, 1.0, 1, 0.0),  # on the DAG, but too tight
        (BESIDE, 0.0, 1, 0.0),  # off the DAG
        *((goal, 1.0, 1, 1.0) for goal in sorted(knot("overhand"))),
    ],
)
def test_episodes_end_at_the_goal_off_the_dag_where_it_is_tight_and_at_the_last_spline(
    training, laid, end, shortest, splines, tied
):
    simulator = laid(None if end is None else shape(end))
    some = training(simulator, shortest_segment=shortest)
    metrics = some.collect()
    assert (metrics["splines"], metrics["tied"]) == (splines, tied)
    stored = sum(map(len, some.buffers.values()))
    assert 0 < stored <= splines * CONFIG.environments  # far grasps teach nothing


def test_a_success_is_worth_what_may_follow_1_at_the_goal_and_0_at_the_end_of_an_episode(training):
    some = training(shortest_segment=0.0)
    first = some.sample(moved(TRIVIAL, "R1(0,1,1)", LOOP))
    assert first.reward == 1.0
    assert {str(action) for action in first.next_actions} == {"C(0,1,1)", "C(1,2,1)"}
    last = some.sample(moved(TWO, "C(2,0,1)", TWO.apply(parse_action("C(2,0,1)"))))
    assert (last.reward, last.next_value, last.next_actions) == (1.0, 1.0, ())
    failed = some.sample(moved(TWO, "C(2,0,1)", TWO))
    assert (failed.reward, failed.next_actions) == (0.0, ())
    beside = some.sample(moved(TRIVIAL, "R2(0,0,1,1)", BESIDE))
    assert beside.reward == 1.0 and np.isnan(beside.next_value) and not beside.next_actions
    tight = training(shortest_segment=1.0).sample(moved(TRIVIAL, "R1(0,1,1)", LOOP))
    assert (tight.reward, tight.next_value, tight.next_actions) == (1.0, 0.0, ())


def test_actions_without_a_primitive_are_left_out(training, make_library, laid):
    primitives = {number: make_library().primitives[number] for number in (1, 3)}
    library = type(make_library())(primitives, {1: [], 3: []}, ROPE)
    some = JointFinetuning(library, {}, [], laid(), CONFIG, 7)
    assert list(map(str, some.sample(moved(TRIVIAL, "R1(0,1,1)", LOOP)).next_actions)) == [
        "C(0,1,1)"
    ]
    assert some.buffers.keys() == {1, 3}
    assert some.collect()["splines"] > 0


def test_earlier_attempts_have_next_values_where_they_ended_on_the_dag(training, laid):
    action = parse_action("R1(0,1,1)")
    points, splines = np.stack([straight(ROPE)] * 3), np.tile([0.5, *[0.1] * 5], (3, 1))
    rollouts = laid(shape(LOOP)).execute(points, splines)
    earlier = Attempts.of(action, TRIVIAL, points, splines, rollouts)
    stored = training(earlier=[earlier], shortest_segment=0.0).buffers[1].sample(10, 1)
    assert stored["reward"].tolist() == [1.0] * 3
    assert ((stored["next_value"] > 0) & (stored["next_value"] < 1)).all()


def test_its_library_samples_for_the_next_action(training, make_library, tmp_path):
    assert "sample_for_next" not in make_library().capabilities
    library = training().library
    library.save(tmp_path / "library.safetensors")
    loaded = type(library).load(tmp_path / "library.safetensors")
    assert "sample_for_next" in loaded.capabilities
    assert not {"arrange", "undo"} & loaded.capabilities


@pytest.mark.parametrize("variant", ["critic_only", "actor_only"])
def test_primitives_without_actor_or_critic_are_refused(make_library, laid, variant):
    with pytest.raises(ValueError, match=f"primitive 1 is {variant}"):
        JointFinetuning(make_library(variant), {}, [], laid(), CONFIG, 7)


@pytest.mark.slow
def test_interrupted_training_ends_the_same(whole_and_resumed, weights):
    whole, resumed = whole_and_resumed
    assert whole.history == resumed.history
    torch.testing.assert_close(weights(resumed), weights(whole), atol=0, rtol=0)

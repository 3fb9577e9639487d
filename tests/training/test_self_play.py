"""Self-play with networks so small that they learn little; its laws do not depend on that."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE, canonicalise
from knotflow.simulation import Attempts, SimulationConfig, check_points, straight
from knotflow.topology import TopologicalState, parse_action
from knotflow.training import LearnerConfig, SelfPlay, SelfPlayConfig
from knotflow.training.transitions import Query, Transition

TRIVIAL = TopologicalState.trivial()
R1 = parse_action("R1(0,1,1)")
CONFIG = SelfPlayConfig(
    LearnerConfig(rollout_ropes=16, rollout_trials=1),
    rounds=2, ropes=1, trials=12, steps=1, new_steps=1, successes_per_step=1, critic_reset_steps=1,
    capacity=200, refreshed=8,
)  # fmt: skip


@pytest.fixture
def training(completed_training):
    return completed_training(SelfPlay, CONFIG)


def test_primitives_that_a_library_lacks_are_added(training, make_library):
    found = training()
    assert set(found.library.primitives) == set(ALL_PRIMITIVES)
    given = make_library().primitives[3].state_dict()
    torch.testing.assert_close(found.library.primitives[3].state_dict(), given)


@pytest.mark.slow
def test_a_rope_that_never_moves_teaches_that_nothing_succeeds_and_its_state_is_kept(training):
    some = training()
    rounds = list(some)
    assert [one["step"] for one in rounds] == [0, 1]
    pairs = some.curriculum.stats.values()
    assert sum(pair.trials for pair in pairs) > 0
    assert sum(pair.successes for pair in pairs) == 0
    acting, arranging = some.buffers[1], some.buffers[ARRANGE]
    assert acting.sample(1000, 1)["reward"].sum() == 0
    kept = arranging.sample(1000, 1)
    assert (kept["reward"] == 1).all()
    assert not kept["next_value"].isnan().any()  # the wanted action is valued after arranging


@pytest.mark.slow
def test_shapes_are_remembered_in_the_states_they_read_as(training, simulator):
    some = training(simulator, guess_fraction=1.0, guess_below_value=1.0, ropes=3, trials=48)
    list(some)
    assert TRIVIAL in set(some.shapes)
    rng = np.random.default_rng(0)
    drawn = set()
    for state in [TRIVIAL] * 20 + [*some.shapes]:
        shape, rope = some.shapes.draw(state, rng)
        assert TopologicalState.from_curve(shape) == state
        check_points(shape, some.ropes[rope])
        drawn.add(rope)
    assert drawn == {0, 1, 2}


@pytest.mark.slow
def test_interrupted_training_ends_the_same(whole_and_resumed, weights):
    whole, resumed = whole_and_resumed
    torch.testing.assert_close(weights(resumed), weights(whole), atol=0, rtol=0)
    assert resumed.curriculum.stats == whole.curriculum.stats


def test_what_independent_training_collected_is_remembered(training, laid):
    rope = straight(SimulationConfig().rope)
    points, splines = np.stack([rope] * 3), np.full((3, 6), 0.1)
    earlier = Attempts.of(R1, TRIVIAL, points, splines, laid().execute(points, splines))
    some = training(earlier=[earlier])
    assert len(some.buffers[1]) == 3
    assert sum(pair.trials for pair in some.curriculum.stats.values()) == 3


def moved(end, arranging=False):
    rope = straight(SimulationConfig().rope)
    query = Query(rope, TRIVIAL, R1, canonicalise(rope, R1))
    return Transition(query, np.full(6, 0.1), rope, end, arranging=arranging)


def test_success_is_followed_by_a_legal_action_and_failure_by_none(training):
    some, end = training(), TRIVIAL.apply(R1)
    done = some.sample(moved(end))
    assert done.reward == 1.0
    end.apply(*done.next_actions)
    failed = some.sample(moved(None))
    assert (failed.reward, failed.next_actions) == (0.0, ())


def test_arranging_is_rewarded_where_the_state_was_kept_and_failures_teach_it_too(training):
    some = training(arranging_share=1.0)
    for end, reward, following in ((TRIVIAL, 1.0, (R1,)), (None, 0.0, ())):
        (sample,) = some.samples(moved(end, arranging=True))
        assert (sample.arranging, sample.reward, sample.next_actions) == (True, reward, following)
        acting, arranging = some.samples(moved(end))
        assert (acting.arranging, acting.reward) == (False, 0.0)
        assert (arranging.arranging, arranging.reward) == (True, reward)

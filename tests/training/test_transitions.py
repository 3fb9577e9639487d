"""What trials of self-play teach."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives.canonical import ARRANGE, canonicalise
from knotflow.simulation import SimulationConfig, resample, straight
from knotflow.topology import TopologicalState, parse_action
from knotflow.topology.draw import draw
from knotflow.training import SelfPlayConfig
from knotflow.training.curriculum import (
    Curriculum,
    Query,
    Sample,
    Transition,
    encode_samples,
    samples,
)

ROPE = SimulationConfig().rope
TRIVIAL = TopologicalState.trivial()
R1 = parse_action("R1(0,1,1)")


@pytest.fixture
def curriculum():
    config = SelfPlayConfig()
    return Curriculum(4, config.crossings_shares, config.undo_share)


def transition(end, arranging=False, value=0.5):
    rope = straight(ROPE)
    query = Query(rope, TRIVIAL, R1, canonicalise(rope, R1))
    return Transition(query, np.full(6, 0.1), rope, end, arranging, value)


def test_success_has_a_next_action_and_failure_none(curriculum, rng):
    end = TRIVIAL.apply(R1)
    (done,) = samples(transition(end), curriculum, 0.0, rng)
    assert (done.reward, done.arranging) == (1.0, False)
    end.apply(done.next_action)  # legal
    (failed,) = samples(transition(None), curriculum, 0.0, rng)
    assert (failed.reward, failed.next_action) == (0.0, None)


@pytest.mark.parametrize(("end", "reward", "next_action"), [(TRIVIAL, 1.0, R1), (None, 0.0, None)])
def test_arranging_is_rewarded_where_the_state_was_kept(curriculum, rng, end, reward, next_action):
    (sample,) = samples(transition(end, arranging=True), curriculum, 0.0, rng)
    assert (sample.arranging, sample.reward, sample.next_action) == (True, reward, next_action)


def test_failed_actions_teach_arranging_with_their_share(curriculum, rng):
    both = list(samples(transition(TRIVIAL), curriculum, 1.0, rng))
    assert [(sample.arranging, sample.reward) for sample in both] == [(False, 0.0), (True, 1.0)]


def test_encoded_samples_go_to_their_primitives_with_next_values(curriculum, rng):
    some = list(samples(transition(TRIVIAL, value=0.25), curriculum, 1.0, rng))
    encoded = dict(encode_samples(some, lambda number, states: torch.full((len(states),), 0.75)))
    assert set(encoded) == {1, ARRANGE}
    assert encoded[1]["next_value"].isnan().all() and encoded[1]["baseline"].tolist() == [0.0]
    assert encoded[ARRANGE]["next_value"].tolist() == [0.75]
    assert encoded[ARRANGE]["next_primitive"].tolist() == [1]
    assert encoded[ARRANGE]["baseline"].tolist() == [0.25]


def test_grasps_far_from_where_an_action_grasps_teach_nothing():
    rope = resample(draw(TopologicalState.parse("2o1+")), ROPE)
    over = parse_action("C(0,1,1)")  # the head goes over
    query = Query(rope, TopologicalState.parse("2o1+"), over, canonicalise(rope, over))
    taught = [
        Sample(Transition(query, np.array([grasp, *[0.1] * 5]), rope, None), False, 1.0, None)
        for grasp in (0.05, 0.9)
    ]
    ((number, trials),) = encode_samples(taught, lambda number, states: torch.zeros(len(states)))
    assert number == 3 and trials.batch_size == (1,)
    assert trials["reward"].tolist() == [1.0] and trials["next_value"].isnan().all()

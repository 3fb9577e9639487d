"""What trials teach: of what was meant, and in hindsight of what was done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from knotflow.simulation import SimulationConfig, resample, straight
from knotflow.topology import TopologicalState, parse_action
from knotflow.topology.draw import draw
from knotflow.training import SelfPlayConfig
from knotflow.training.curriculum import Curriculum, outcomes
from knotflow.training.lessons import Lesson, Lessons, Trial, encoded

ROPE = SimulationConfig().rope
TRIVIAL = TopologicalState.trivial()
MEANT, DONE = parse_action("R1(0,1,1)"), parse_action("R1(0,-1,1)")


def lessons(**changes):
    config = replace(SelfPlayConfig(arranging_share=0.0), **changes)
    curriculum = Curriculum(4, config.crossings_shares, config.undo_share)
    return Lessons(curriculum, config, np.random.default_rng(0))


def trial(end, state=TRIVIAL, action=MEANT):
    rope = straight(ROPE)
    return Trial(rope, state, action, np.full(6, 0.1), rope, end)


def test_a_success_has_a_next_action_and_a_failure_none():
    some, onward = lessons(), TRIVIAL.apply(MEANT)
    (done,) = some.of(trial(onward), arranging=False, value=0.5)
    assert (done.action, done.reward, done.arranging) == (MEANT, 1.0, False)
    onward.apply(done.following)  # legal
    assert done.after is not None
    (failed,) = some.of(trial(None), arranging=False, value=0.5)
    assert (failed.reward, failed.following, failed.after) == (0.0, None, None)


def test_arranging_is_told_whether_the_state_was_kept_and_what_it_was_worth_before():
    some = lessons(hindsight=False)
    (kept,) = some.of(trial(TRIVIAL), arranging=True, value=0.3)
    assert (kept.arranging, kept.reward, kept.baseline, kept.following) == (True, 1.0, 0.3, MEANT)
    (lost,) = some.of(trial(None), arranging=True, value=0.3)
    assert (lost.arranging, lost.reward, lost.following) == (True, 0.0, None)


def test_a_failure_teaches_arranging_as_often_as_it_shall():
    both = [*lessons(arranging_share=1.0).of(trial(TRIVIAL), arranging=False, value=0.2)]
    assert [(lesson.arranging, lesson.reward) for lesson in both] == [(False, 0.0), (True, 1.0)]


def test_a_trial_that_did_something_else_is_a_success_of_that_in_hindsight():
    some, end = lessons(), outcomes(TRIVIAL, 4)[DONE]
    _, lesson = some.of(trial(end), arranging=False, value=0.0)
    assert (lesson.action, lesson.reward, lesson.weight) == (DONE, 1.0, 1.0)
    assert lesson.pull < 1
    # From then on a trial for the same action that ends elsewhere is a failure of that one.
    _, lesson = some.of(trial(TRIVIAL), arranging=False, value=0.0)
    assert (lesson.action, lesson.reward) == (DONE, 0.0)
    # Success at what was meant is not told twice.
    first, *others = some.of(trial(outcomes(TRIVIAL, 4)[MEANT]), arranging=False, value=0.0)
    assert (first.action, first.reward) == (MEANT, 1.0)
    assert [lesson.reward for lesson in others] == [0.0]
    alone = lessons(hindsight=False).of(trial(end), arranging=False, value=0.0)
    assert [lesson.action for lesson in alone] == [MEANT]


def test_what_was_done_in_hindsight_survives_saving():
    some = lessons()
    list(some.of(trial(outcomes(TRIVIAL, 4)[DONE]), arranging=False, value=0.0))
    again = lessons()
    again.load_state_dict(some.state_dict())
    _, lesson = again.of(trial(TRIVIAL), arranging=False, value=0.0)
    assert (lesson.action, lesson.reward) == (DONE, 0.0)


def test_grasps_far_from_where_an_action_grasps_teach_nothing():
    rope = resample(draw(TopologicalState.parse("2o1+")), ROPE)
    over = parse_action("C(0,1,1)")  # the head goes over
    taught = [Lesson(rope, over, np.array([grasp, *[0.1] * 5]), 1.0) for grasp in (0.05, 0.9)]
    ((number, trials),) = encoded(taught, lambda number, states: torch.zeros(len(states)))
    assert number == 3 and trials.batch_size == (1,)
    assert trials["reward"].tolist() == [1.0] and trials["next_value"].isnan().all()

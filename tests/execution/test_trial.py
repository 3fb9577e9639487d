"""Executions are judged by where the rope truly lies."""

from types import SimpleNamespace

import numpy as np
import pytest

from knotflow.execution import CONTROLS, Sight, Twin, TwinConfig, failure, try_plan
from knotflow.planning import parse_goal
from knotflow.simulation import RopeConfig, straight


@pytest.fixture(scope="module")
def goal():
    return parse_goal("R1(0,1,1)")


def twin_of(plan, **config):
    return Twin(plan.start, TwinConfig(level=0, **config), np.random.default_rng(1))


@pytest.mark.parametrize("control", ["open_loop", "replan_true_state"])
def test_a_plan_that_works_is_tied_on_the_planners_rope(plan, goal, control):
    trial = try_plan(plan, goal, twin_of(plan), CONTROLS[control], replan=lambda points: plan)
    assert trial.tied and trial.cause == ""
    assert 0 < trial.deviation < 0.05
    assert trial.execution.tied is (None if control == "open_loop" else True)


def test_a_grasp_that_misses_is_the_cause(plan, goal):
    trial = try_plan(plan, goal, twin_of(plan, reach=0.0), CONTROLS["open_loop"])
    assert not trial.tied and trial.cause == "grasp missed"


def test_every_failure_has_the_first_cause_that_applies(plan, goal):
    looped, flat = plan.steps[0].end, straight(RopeConfig())

    def cause(points, sight, missed=0):
        return failure(
            SimpleNamespace(sight=sight), goal, SimpleNamespace(points=points, missed=missed)
        )

    mirrored = looped * [1.0, -1.0, 1.0]
    assert cause(looped, None, missed=1) == ""
    assert cause(flat, Sight.nothing("dark")) == "rope not seen"
    assert cause(flat, Sight.of(looped)) == "state misread"
    assert cause(flat, Sight.of(flat), missed=1) == "action failed"
    assert cause(flat, None, missed=1) == "grasp missed"
    assert cause(mirrored, None) == "out of the DAG"
    assert cause(flat, None) == "action failed"


@pytest.mark.slow
@pytest.mark.parametrize("control", ["mppi_true_state", "mppi_true_state_mujoco"])
def test_mppi_follows_a_plan_by_either_model(plan, goal, control):
    trial = try_plan(plan, goal, twin_of(plan), CONTROLS[control])
    assert trial.tied and trial.deviation < 0.03
    assert len(trial.execution.tick_seconds) > 5

"""Executions are judged by where the rope truly lies."""

from types import SimpleNamespace

import numpy as np
import pytest

from knotflow.execution import (
    CONTROLLERS,
    ExecutionConfig,
    LstmDynamics,
    Mppi,
    MppiConfig,
    MujocoDynamics,
    Observation,
    TrueState,
    Twin,
    TwinConfig,
    execute,
    failure_cause,
    run_trial,
)
from knotflow.perception import Camera
from knotflow.planning import parse_goal
from knotflow.simulation import RopeConfig, straight


@pytest.fixture(scope="module")
def goal():
    return parse_goal("R1(0,1,1)")


def twin_of(plan, **config):
    return Twin(plan.start, TwinConfig(level=0, **config), np.random.default_rng(1))


@pytest.mark.slow
def test_working_plan_ties_the_nominal_rope(plan, goal):
    trial = run_trial(plan, goal, twin_of(plan), CONTROLLERS["open_loop"])
    assert trial.tied and trial.cause == "" and trial.execution.tied is None
    assert 0 < trial.deviation < 0.05


def test_missed_grasp_is_the_cause(plan, goal):
    trial = run_trial(plan, goal, twin_of(plan, reach=0.0), CONTROLLERS["open_loop"])
    assert not trial.tied and trial.cause == "grasp missed"


def test_failure_cause_is_the_first_that_applies(plan, goal):
    looped, flat = plan.steps[0].end, straight(RopeConfig())

    def cause(points, observation, missed=0, **last):
        outcomes = (SimpleNamespace(**({"held": True, "tracked": True} | last)),)
        return failure_cause(
            SimpleNamespace(observation=observation, outcomes=outcomes),
            goal,
            SimpleNamespace(points=points, missed_grasps=missed),
        )

    mirrored = looped * [1.0, -1.0, 1.0]
    assert cause(looped, None, missed=1) == ""
    assert cause(flat, Observation(None, None, ("dark",))) == "rope not seen"
    assert cause(flat, Observation.of(looped)) == "state misread"
    assert cause(flat, Observation.of(flat, ("blurred",)), held=False) == "state in doubt"
    assert cause(flat, Observation.of(flat), held=False, tracked=False) == "track lost"
    assert cause(flat, Observation.of(flat), held=False) == "grasp missed"
    assert cause(flat, Observation.of(flat), missed=1) == "action failed"
    assert cause(flat, None, missed=1) == "grasp missed"
    assert cause(mirrored, None) == "out of the DAG"
    assert cause(flat, None) == "action failed"


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", [LstmDynamics.load, MujocoDynamics])
def test_mppi_tracks_a_plan_by_either_model(plan, goal, dynamics):
    twin, controller = twin_of(plan), Mppi(dynamics(), MppiConfig(samples=16, horizon=3))
    execution = execute(plan, twin.robot(), source=TrueState(twin), controller=controller)
    assert failure_cause(execution, goal, twin) == ""
    away = np.linalg.norm(execution.reference - np.array(twin.trajectory), axis=-1)
    assert np.nanmean(away) < 0.03
    assert len(execution.ticks) > 5
    assert all(tick.control > 0 and tick.image == 0 for tick in execution.ticks)


@pytest.mark.slow
def test_knot_is_tied_by_vision(plan, goal):
    camera = Camera.overhead()
    twin = Twin(plan.start, TwinConfig(level=1), np.random.default_rng(4), camera)
    config = ExecutionConfig(max_actions=1)
    trial = run_trial(
        plan, goal, twin, CONTROLLERS["mppi_replan"], config, lambda points: plan, camera
    )
    execution = trial.execution
    assert trial.tied and execution.tied and execution.observation.ambiguities == ()
    assert np.linalg.norm(execution.observation.points - twin.points, axis=1).mean() < 0.01
    dragged = ~np.isnan(execution.reference[:, 0, 0])
    away = execution.points[dragged] - np.array(twin.trajectory)[dragged]
    assert np.linalg.norm(away, axis=-1).mean() < 0.015
    assert len(execution.ticks) == dragged.sum()
    assert all(min(tick.image, tick.track, tick.control) > 0 for tick in execution.ticks)

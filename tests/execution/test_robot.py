"""Whatever fails, no knot is reported that is not there."""

import numpy as np
import pytest

from knotflow.execution import FAULTS, STEP, TrueState, Twin, TwinConfig, execute
from knotflow.perception import Camera, TraceError, estimate
from knotflow.simulation import RopeConfig, state_or_none

CAMERA = Camera.overhead(160, 120)


def twin_of(plan, camera=None):
    return Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1), camera)


def grasped(robot, seconds):
    """The robot, so long after its fingers closed."""
    robot.grasp()
    for _ in range(round(seconds / STEP)):
        robot.move_to(robot.position, STEP)
    return robot


def test_frames_lost_for_a_second(plan):
    robot = FAULTS["frames lost"](twin_of(plan, CAMERA).robot())
    robot.observe()
    grasped(robot, 1.0)
    for _ in range(10):
        with pytest.raises(TimeoutError):
            robot.observe()
        robot.move_to(robot.position, STEP)
    robot.observe()
    grasped(robot, 1.5).observe()  # once is enough


def test_occluded_rope_is_not_estimated(plan):
    robot = FAULTS["table alone"](twin_of(plan, CAMERA).robot())
    assert estimate(robot.observe(), CAMERA, RopeConfig(), plan.start).coverage_fraction > 0.9
    with pytest.raises(TraceError):
        estimate(grasped(robot, 1.0).observe(), CAMERA, RopeConfig(), likely=[plan.start])


def test_dropped_rope_is_not_reported_tied(plan):
    twin = twin_of(plan)
    true = TrueState(twin)
    execution = execute(plan, FAULTS["rope dropped"](twin.robot()), source=true, estimator=true)
    assert not execution.outcomes[0].held
    assert execution.tied == (state_or_none(twin.points) in plan.goal_states)


def test_no_fault_by_default(plan):
    twin = twin_of(plan)
    execute(plan, FAULTS[""](twin.robot()))
    assert state_or_none(twin.points) in plan.goal_states

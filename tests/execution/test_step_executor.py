"""A step is grasped where the rope lies, and an end is pulled without undoing anything."""

import numpy as np
import pytest

from knotflow.execution import ExecutionConfig, Twin, TwinConfig
from knotflow.execution.step_executor import (
    StepExecutor,
    interpolate_rope,
    path_from_grasp,
)
from knotflow.simulation import state_or_none


@pytest.mark.parametrize(("ends", "turn", "end"), [((0,), 1, 0), ((-1,), 0, -1), ((-1, 0), 1, 0)])
def test_ambiguous_ends_are_pulled_in_turn(ends, turn, end, plan):
    twin = Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1))
    before = twin.points
    StepExecutor(twin.robot(), ExecutionConfig(), points=before).pull(0, ends, turn)
    outward = before[end] - before.mean(axis=0)
    assert 0.02 < (twin.points - before)[end] @ outward / np.linalg.norm(outward) < 0.06


def test_pull_preserves_the_state(plan):
    step = plan.steps[0]
    twin = Twin(step.end, TwinConfig(level=1), np.random.default_rng(1))
    run = StepExecutor(twin.robot(), ExecutionConfig(), points=twin.points)
    before = twin.points
    run.pull(0)
    moved = np.linalg.norm(twin.points - before, axis=1)[[0, -1]]
    assert 0.02 < moved.max() < 0.06
    assert state_or_none(twin.points) == step.end_state
    assert not run.closed and not twin.grasped


def test_path_from_another_grasp_ends_as_planned(plan):
    step = plan.steps[0]
    path = path_from_grasp(step, step.gripper[0] + [0.0, 0.02, 0.0])
    np.testing.assert_allclose(path[0] - step.gripper[0], [0.0, 0.02, 0.0], atol=1e-6)
    np.testing.assert_allclose(path[-1], step.gripper[-1], atol=1e-6)


def test_rope_is_interpolated_between_frames(plan):
    step = plan.steps[0]
    middle = (step.times[3] + step.times[4]) / 2
    wanted = (step.trajectory[3] + step.trajectory[4]) / 2
    ropes = interpolate_rope(step, np.array([middle, step.times[-1]]))
    np.testing.assert_allclose(ropes[0], wanted, atol=1e-6)
    np.testing.assert_allclose(ropes[1], step.trajectory[-1], atol=1e-6)

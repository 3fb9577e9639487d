"""A step is grasped where the rope lies, and an end is pulled without undoing anything."""

import numpy as np
import pytest

from knotflow.execution import ExecutionConfig, TrueState, Twin, TwinConfig
from knotflow.execution.robot import RobotError
from knotflow.execution.step_executor import (
    StepExecutor,
    interpolate_rope,
    path_from_grasp,
)
from knotflow.planning import GripperConfig
from knotflow.simulation import grasped_link, state_or_none


@pytest.mark.parametrize(("ends", "turn", "end"), [((0,), 1, 0), ((-1,), 0, -1), ((-1, 0), 1, 0)])
def test_ambiguous_ends_are_pulled_in_turn(ends, turn, end, plan):
    twin = Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1))
    before = twin.points
    StepExecutor(twin.robot(), ExecutionConfig(), points=before).pull(0, plan.radius, ends, turn)
    outward = before[end] - before.mean(axis=0)
    assert 0.02 < (twin.points - before)[end] @ outward / np.linalg.norm(outward) < 0.06


def test_pull_preserves_the_state(plan):
    step = plan.steps[0]
    twin = Twin(step.end, TwinConfig(level=1), np.random.default_rng(1))
    run = StepExecutor(twin.robot(), ExecutionConfig(), points=twin.points)
    before = twin.points
    run.pull(0, plan.radius)
    moved = np.linalg.norm(twin.points - before, axis=1)[[0, -1]]
    assert 0.02 < moved.max() < 0.06
    assert state_or_none(twin.points) == step.end_state
    assert not run.closed and not twin.grasped


def test_gripper_travels_above_a_pile_to_the_end_that_it_pulls(plan):
    twin = Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1))
    pile = plan.start.copy()
    pile[len(pile) // 2, 2] = 0.3
    run = StepExecutor(twin.robot(), ExecutionConfig(), points=pile)
    run.pull(0, 0.05)
    highest = max(move.gripper[2] for move in run.moves)
    assert highest == pytest.approx(0.3 + 0.05 + run.config.gripper.clearance)


class Stalled:
    """A robot that stays where it is, and may not know where that is."""

    def __init__(self, position):
        self.position, self.moves = np.array(position), 0

    def move_to(self, position, seconds):
        self.moves += 1


@pytest.mark.parametrize(
    ("position", "told", "most"),
    [((0.0, 0.0, 0.3), "m from where it was sent", 40), ((0.0, np.nan, 0.3), "nan", 1)],
)
def test_a_robot_that_does_not_follow_is_told_from_one_that_does(position, told, most):
    robot = Stalled(position)
    executor = StepExecutor(robot, ExecutionConfig(), corrects=True)
    with pytest.raises(RobotError, match=told):
        executor.observe(None, 0)
    assert robot.moves <= most


def test_a_robot_that_takes_announced_moves_and_stays_does_not_grasp(plan):
    class Announced(Stalled):
        grasps = 0

        def expect(self, positions, seconds, strand=None):
            return True

        def grasp(self):
            self.grasps += 1

    robot = Announced((0.0, 0.0, 0.3))
    executor = StepExecutor(robot, ExecutionConfig(), corrects=True)
    with pytest.raises(RobotError, match="m from where it was sent"):
        executor.execute(plan.steps[0], plan, 0)
    assert robot.grasps == 0


@pytest.mark.parametrize("lowest", [0.008, 0.02])
def test_fingers_on_the_table_are_not_pressed_into_it(plan, lowest):
    class OnTable(Stalled):
        sent = np.inf

        def move_to(self, position, seconds):
            self.sent = min(self.sent, position[2])
            self.position = np.array([*position[:2], max(position[2], lowest)])

        def grasp(self):
            pass

        release = grasp

    robot = OnTable((0.0, 0.0, 0.3))
    StepExecutor(robot, ExecutionConfig(), corrects=True).execute(plan.steps[0], plan, 0)
    planned = plan.steps[0].gripper[:, 2].min()
    assert robot.sent >= max(planned - 0.002, planned / 2) - 1e-9


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


class Recording:
    """A controller that keeps what it is given and follows the path."""

    def begin(self, reference, path, weights, grasped):
        self.reference, self.path, self.number = reference, path, 0

    def act(self, points, velocities, gripper):
        self.number += 1
        return self.path[self.number]


@pytest.mark.parametrize("speed", [np.inf, 0.1])
def test_the_reference_keeps_the_time_of_a_slowed_path(plan, speed):
    step, controller = plan.steps[0], Recording()
    twin = Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1))
    config = ExecutionConfig(gripper=GripperConfig(drag_speed=speed))
    executor = StepExecutor(twin.robot(), config, TrueState(twin), controller)
    executor.execute(step, plan, 0)
    link = int(grasped_link(step.spline, len(step.start) - 1))
    held = (controller.reference[:, link] + controller.reference[:, link + 1]) / 2
    away = np.linalg.norm(held - controller.path, axis=1)
    assert away.max() < 0.03


def test_a_robot_that_stays_is_noticed_in_open_loop(plan):
    class Still(Stalled):
        def grasp(self):
            pass

        release = grasp

    executor = StepExecutor(Still((0.0, 0.0, 0.3)), ExecutionConfig())
    with pytest.raises(RobotError, match="m from where it was sent"):
        executor.execute(plan.steps[0], plan, 0)


def test_a_position_is_three_numbers():
    with pytest.raises(RobotError, match=r"the gripper's position is \(3,\), metres, got \(7,\)"):
        StepExecutor(Stalled(np.zeros(7)), ExecutionConfig(), corrects=True).observe(None, 0)


def test_fingers_do_not_pull_from_under_the_table(plan):
    twin = Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1))
    sunk = plan.start - [0.0, 0.0, 0.02]
    run = StepExecutor(twin.robot(), ExecutionConfig(), points=sunk)
    run.pull(0, plan.radius)
    assert min(move.gripper[2] for move in run.moves) >= 0.0

"""A step is grasped where the rope lies, and an end is pulled without undoing anything."""

import numpy as np
import pytest

from knotflow.execution import STEP, ExecutionConfig, Observation, TrueState, Twin, TwinConfig
from knotflow.execution.robot import RobotError
from knotflow.execution.step_executor import (
    StepExecutor,
    interpolate_rope,
    path_from_grasp,
)
from knotflow.planning import GripperConfig
from knotflow.simulation import grasped_link, state_or_none
from knotflow.topology import project


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
    [
        ((0.0, 0.0, 0.3), "m from where it was sent", 40),
        ((0.0, np.nan, 0.3), "nan", 1),
        ((0.0, 0.0, 300.0), "300 m from the origin: positions are metres", 1),
    ],
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


class Lab:
    """A robot that goes where it is sent, but for an error, and writes down what it is told."""

    def __init__(self, off=(0.0, 0.0, 0.0), takes_announced=False):
        self.off, self.takes_announced = np.array(off), takes_announced
        self.at, self.sent, self.told, self.asked = np.array([0.0, 0.0, 0.3]), [], [], 0

    @property
    def position(self):
        self.asked += 1
        return self.at.copy()

    def move_to(self, position, seconds):
        self.sent.append(np.array(position))
        self.at = position + self.off

    def grasp(self):
        self.told.append("grasp")

    def release(self):
        self.told.append("release")

    def open_to(self, opening):
        self.told.append(opening)

    def expect(self, positions, seconds, strand=None):
        self.told.append((len(positions), strand))
        return self.takes_announced


class Dragged:
    """A rope of which the held link trails the gripper by so many metres."""

    lost = False

    def __init__(self, rope, trailing=0.0):
        self.rope, self.trailing, self.caught, self.last = rope, trailing, None, None

    def points(self, robot, grasped):
        place = robot.position
        if grasped and self.caught is None:
            self.caught = self.last = place
        if grasped:
            moved = place - self.last
            behind = self.trailing * moved / max(np.linalg.norm(moved), 1e-9)
            self.last = place
            return self.rope + place - behind - self.caught
        return self.rope


def test_the_gripper_rises_from_where_it_let_go(plan):
    class Aside(Recording):
        def act(self, points, velocities, gripper):
            return super().act(points, velocities, gripper) + [0.02, 0.01, -0.004]

    robot, controller = Lab(), Aside()
    source = Dragged(plan.start)
    executor = StepExecutor(robot, ExecutionConfig(), source, controller)
    assert executor.execute(plan.steps[0], plan, 0).held
    after = np.array([move.gripper for move in executor.moves[-10:]])
    let_go = controller.path[-1]
    np.testing.assert_allclose(after[:, :2], np.tile(let_go[:2] + [0.02, 0.01], (10, 1)))
    first = next(row for row, move in enumerate(executor.moves) if move.closed)
    opened = [move.gripper[2] for move in executor.moves[first:] if not move.closed]
    assert min(opened) >= let_go[2] and opened[-1] > let_go[2] + 0.05


class Blind:
    """It sees no image."""

    def estimate(self, robot, likely=()):
        return None


def test_a_new_image_is_waited_for(plan):
    executor = StepExecutor(Lab(), ExecutionConfig(image_timeout=2.0))
    observation = executor.observe(Blind(), 0)
    assert observation.ambiguities == ("no new image came for 2 s",)
    parked = np.array(executor.config.park_position)
    waited = sum(np.allclose(move.gripper, parked, atol=1e-12) for move in executor.moves)
    assert waited == 2 + 20  # as it arrives, to stand still, and for two seconds


def test_the_time_that_a_driver_waits_for_an_image_counts(plan, monkeypatch):
    now, asked = [0.0], []

    class Slow:
        def estimate(self, robot, likely=()):
            asked.append(now[0])
            now[0] += 0.8

    monkeypatch.setattr("knotflow.execution.step_executor.time.monotonic", lambda: now[0])
    StepExecutor(Lab(), ExecutionConfig(image_timeout=2.0)).observe(Slow(), 0)
    assert asked == pytest.approx([0.0, 0.8, 1.6, 2.4])


def test_a_rope_that_was_looked_at_does_not_move(plan):
    class Seen:
        def estimate(self, robot, likely=()):
            return Observation.of(plan.steps[0].end)

    class Speeds(Recording):
        speeds = ()

        def act(self, points, velocities, gripper):
            self.speeds = (*self.speeds, velocities)
            return super().act(points, velocities, gripper)

    robot, controller, step = Lab(), Speeds(), plan.steps[0]
    executor = StepExecutor(robot, ExecutionConfig(), None, controller, points=step.start)
    executor.observe(Seen(), 0)
    np.testing.assert_array_equal(executor.points, step.end)
    np.testing.assert_array_equal(executor.previous_points, step.end)

    executor.source = Dragged(step.start)
    executor.execute(step, plan, 0)
    path = np.array([move.gripper for move in executor.moves if move.reference is not None])
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1) / STEP
    told = np.array([np.linalg.norm(one, axis=1).max() for one in controller.speeds])
    np.testing.assert_allclose(told[2:], moved[: len(told) - 2], atol=1e-9)
    assert told.max() > 0.1  # metres a second


@pytest.mark.parametrize("tail", [False, True])
def test_the_outer_end_is_pulled_first_level_and_not_too_fast(plan, tail):
    rope = plan.start + [0.0, 0.0, 0.05] * np.linspace(1, 0, len(plan.start))[:, None] ** 8
    rope[: len(rope) // 2, 1] += 0.3 * np.linspace(1, 0, len(rope) // 2) ** 2  # the head lies far
    outer = rope[0]
    if tail:
        rope = rope[::-1].copy()
    robot = Lab()
    executor = StepExecutor(robot, ExecutionConfig(), points=rope)
    executor.pull(0, plan.radius)
    pulled = np.array([move.gripper for move in executor.moves if move.closed])
    assert np.linalg.norm((pulled[0] - outer)[:2]) < 0.02
    np.testing.assert_allclose(pulled[:, 2], pulled[0, 2])
    along = (pulled[-1] - pulled[0])[:2]
    assert np.linalg.norm(along) == pytest.approx(0.04)
    gripper = executor.config.gripper.clear_of(rope, plan.radius)
    speeds = np.linalg.norm(np.diff(pulled, axis=0), axis=1) / STEP
    assert 0.5 * gripper.vertical_speed < speeds.max() <= gripper.vertical_speed + 1e-9
    strands = {one[1] for one in robot.told if isinstance(one, tuple)} - {None}
    (strand,) = strands
    np.testing.assert_allclose([np.cos(strand), np.sin(strand)], along / 0.04, atol=0.01)


def test_fingers_close_across_the_grasped_strand_as_wide_as_there_is_room(plan):
    step, robot = plan.steps[0], Lab()
    turned = step.start[:, [1, 0, 2]] * [1, -1, 1]  # the rope lies along -y
    StepExecutor(robot, ExecutionConfig(), points=turned).execute(step, plan, 0)
    strands = {one[1] for one in robot.told if isinstance(one, tuple)} - {None}
    link = int(grasped_link(step.spline, len(turned) - 1))
    x, y, _ = turned[link + 1] - turned[link]
    assert strands == {np.arctan2(y, x)}
    grasp, release = robot.told.index("grasp"), robot.told.index("release")
    opened = [row for row, one in enumerate(robot.told) if isinstance(one, float)]
    assert len(opened) == 2 and opened[0] < grasp < opened[1] < release


@pytest.mark.parametrize("takes_announced", [False, True])
def test_positions_are_asked_for_where_moves_are_not_announced(plan, takes_announced):
    robot = Lab(takes_announced=takes_announced)
    executor = StepExecutor(robot, ExecutionConfig(), corrects=True)
    executor.execute(plan.steps[0], plan, 0)
    assert (robot.asked < 0.2 * len(robot.sent)) == takes_announced


@pytest.mark.parametrize(("share", "held"), [(0.8, True), (1.3, False)])
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_a_link_that_trails_by_more_than_slip_and_lag_is_lost(plan, share, held, lag):
    class Even(Recording):
        """3 cm a move."""

        def act(self, points, velocities, gripper):
            self.number += 1
            return self.path[0] + [0.03 * self.number, 0.0, 0.0]

    config = ExecutionConfig(slip=0.02, lag=lag)
    source = Dragged(plan.start, share * (config.slip + lag * 0.03 / STEP))
    executor = StepExecutor(Lab(), config, source, Even())
    assert executor.execute(plan.steps[0], plan, 0).held == held


def test_a_rope_caught_beside_the_gripper_is_held_there(plan):
    """What a link was off when the fingers closed is not slip."""
    beside = plan.start + [0.0, 0.0, 0.025]
    config = ExecutionConfig(slip=0.01, lag=0.0)
    executor = StepExecutor(Lab(off=(0.0, 0.0, 0.02)), config, Dragged(beside, 0.005))
    assert executor.execute(plan.steps[0], plan, 0).held


def test_vertices_at_crossings_weigh_most(plan):
    class Weighed(Recording):
        def begin(self, reference, path, weights, grasped):
            super().begin(reference, path, weights, grasped)
            self.weights = weights

    controller, step = Weighed(), plan.steps[0]
    executor = StepExecutor(Lab(), ExecutionConfig(), Dragged(step.start), controller)
    executor.execute(step, plan, 0)
    weights, along = controller.weights, np.linspace(0, 1, len(step.end))
    assert weights.mean() == pytest.approx(1.0)
    crossings = project(step.end).fractions
    at = [np.abs(along - fraction).argmin() for fraction in crossings]
    far = np.abs(along[:, None] - crossings).min(axis=1).argmax()
    assert (weights[at] > 3 * weights[far]).all() and weights.max() < 4.1 * weights[far]


def test_a_constant_error_is_made_up_for(plan):
    robot = Lab(off=(0.01, -0.02, 0.0))
    executor = StepExecutor(robot, ExecutionConfig(), corrects=True)
    executor.execute(plan.steps[0], plan, 0)
    arrived = np.array(robot.sent) + robot.off
    wanted = np.array([move.gripper for move in executor.moves])
    np.testing.assert_allclose(arrived[1:], wanted[1:], atol=1e-9)


def test_a_correction_never_sends_the_gripper_lower_than_half_its_height():
    robot = Lab()
    config = ExecutionConfig(park_position=(0.0, 0.0, 0.002), image_timeout=0.0)
    executor = StepExecutor(robot, config, error=np.array([0.0, 0.0, 0.002]))
    executor.observe(Blind(), 0)
    assert robot.sent[-1][2] == pytest.approx(0.001)

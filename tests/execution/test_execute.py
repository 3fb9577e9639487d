"""Plans are executed with five words, and a lost rope is noticed."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.execution import (
    STEP,
    ExecutionConfig,
    Sight,
    TrueState,
    Twin,
    TwinConfig,
    execute,
)
from knotflow.execution.follow import Run, from_grasp, rope_at
from knotflow.planning import UnreachableGoalError
from knotflow.simulation import state_or_none


class Recorded:
    """A robot of five words that writes down what it is told."""

    def __init__(self, fails_at=None):
        self.words, self.at, self.fails_at = [], np.array([0.0, 0.0, 0.3]), fails_at

    def observe(self):
        self.words.append("observe")
        return "an image"

    def move_to(self, position, seconds):
        self.words.append("move_to")
        if len(self.words) == self.fails_at:
            raise ConnectionError("the arm stopped")
        assert seconds == pytest.approx(STEP)
        self.at = np.array(position)

    def grasp(self):
        self.words.append("grasp")

    def release(self):
        self.words.append("release")

    @property
    def position(self):
        return self.at.copy()


def twin_of(plan, level=0, **config):
    return Twin(plan.start, TwinConfig(level=level, **config), np.random.default_rng(1))


def test_open_loop_goes_where_the_plan_says_and_looks_at_nothing(plan):
    robot = Recorded()
    execution = execute(plan, robot)
    assert "observe" not in robot.words
    assert [word for word in robot.words if word != "move_to"] == ["grasp", "release", "release"]
    dragged = ~np.isnan(execution.reference[:, 0, 0])
    np.testing.assert_allclose(execution.gripper[dragged], plan.steps[0].gripper[1:19], atol=1e-3)
    assert execution.closed[dragged].all()
    assert np.isnan(execution.points).all() and execution.ticks == ()
    travel = plan.waypoints(1 / STEP)
    np.testing.assert_allclose(execution.gripper[-len(travel) :], travel.positions, atol=1e-3)


def test_the_nominal_twin_does_what_was_planned(plan):
    for source in (False, True):
        twin = twin_of(plan)
        execute(plan, twin.robot(), source=TrueState(twin) if source else None)
        assert state_or_none(twin.points) in plan.goal_states


def test_in_closed_loop_the_rope_is_grasped_where_it_lies(plan):
    moved = plan.start + [0.0, 0.04, 0.0]
    twin = Twin(moved, TwinConfig(level=0), np.random.default_rng(1))
    execution = execute(plan, twin.robot(), source=TrueState(twin))
    assert execution.reason == "every step was executed"
    twin = Twin(moved, TwinConfig(level=0), np.random.default_rng(1))
    execute(plan, twin.robot())  # open loop grasps air, and does not know
    np.testing.assert_allclose(twin.points, moved, atol=1e-3)


def test_a_robots_error_is_made_up_for_in_closed_loop(plan):
    twin = twin_of(plan, level=2)
    execution = execute(plan, twin.robot(), source=TrueState(twin))
    assert execution.reason == "every step was executed"
    held = np.flatnonzero(execution.closed)
    assert np.linalg.norm(execution.gripper[held[-1]] - plan.steps[0].gripper[-1]) < 1e-3


def test_a_rope_that_cannot_be_held_is_given_up_and_said(plan):
    twin = twin_of(plan, reach=0.0)
    config = ExecutionConfig(attempts=2)
    execution = execute(plan, twin.robot(), config, TrueState(twin))
    assert execution.reason == "the rope was lost in all 2 attempts at step 0"
    np.testing.assert_allclose(twin.points, plan.start, atol=1e-3)


def test_a_source_gets_images_gripper_and_fingers(plan):
    seen = []

    class Source:
        lost = False

        def points(self, robot, grasped):
            seen.append((robot.observe(), robot.position.shape, grasped))
            return plan.start

    execute(plan, Recorded(), ExecutionConfig(slip=10.0), Source())
    assert {one[:2] for one in seen} == {("an image", (3,))}
    assert {one[2] for one in seen} == {False, True}


def test_a_robot_that_fails_lets_go(plan):
    robot = Recorded(fails_at=40)
    with pytest.raises(ConnectionError):
        execute(plan, robot)
    assert robot.words[-1] == "release"


def replanned(plan, **changes):
    """A planner that always answers with the same plan, changed, and what it was asked."""
    asked = []

    def replan(points):
        asked.append(points)
        return replace(plan, **changes)

    return asked, replan


class Scripted:
    """A look that shows what it was told to, one sight after the other."""

    def __init__(self, *sights):
        self.sights, self.likely, self.places = list(sights), [], []

    def look(self, robot, likely=()):
        self.likely.append(likely)
        self.places.append(robot.position)
        return self.sights.pop(0)


def test_in_open_loop_nobody_knows_whether_it_is_tied(plan):
    assert execute(plan, Recorded()).tied is None


def test_a_knot_that_is_seen_is_reported(plan):
    twin = twin_of(plan)
    asked, replan = replanned(plan)
    true = TrueState(twin)
    execution = execute(plan, twin.robot(), source=true, look=true, replan=replan)
    assert execution.tied
    assert execution.reason == "the knot is seen to be tied after 1 actions"
    assert asked == []  # the rope lay as the plan begins
    (outcome,) = execution.outcomes
    assert outcome.found == outcome.expected == plan.steps[0].end_state and outcome.held


def test_after_each_action_it_is_planned_anew_from_where_the_rope_lies(plan):
    start, goal = Sight.of(plan.start), Sight.of(plan.steps[0].end)
    asked, replan = replanned(plan)
    look = Scripted(start, start, goal)
    execution = execute(plan, Recorded(), look=look, replan=replan)
    assert execution.tied and len(execution.outcomes) == 2
    np.testing.assert_array_equal(asked, [plan.start])
    assert [one.found for one in execution.outcomes] == [start.state, goal.state]


def test_another_state_than_the_plans_first_is_planned_from(plan):
    goal = Sight.of(plan.steps[0].end)
    elsewhere = replace(plan, goal_states=(plan.start_state,))
    asked, replan = replanned(elsewhere)
    execution = execute(
        elsewhere, Recorded(), look=Scripted(goal, Sight.of(plan.start)), replan=replan
    )
    np.testing.assert_array_equal(asked, [goal.points])
    assert execution.tied


def test_without_a_plan_it_stops_and_says_why(plan):
    start = Sight.of(plan.start)
    asked, replan = replanned(plan, steps=(), solved=False, reason="no way")
    execution = execute(plan, Recorded(), look=Scripted(start, start), replan=replan)
    assert execution.reason == "no plan was found after 1 actions: no way"
    assert len(asked) == 4  # it was searched again before that

    def unreachable(points):
        raise UnreachableGoalError("there is no way")

    execution = execute(plan, Recorded(), look=Scripted(start, start), replan=unreachable)
    assert execution.reason == "there is no plan after 1 actions: there is no way"
    assert execution.tied is False


def test_a_plan_that_ends_before_the_goal_is_begun_and_made_anew(plan):
    start, goal = Sight.of(plan.start), Sight.of(plan.steps[0].end)
    asked, replan = replanned(plan, solved=False, reason="no way")
    look = Scripted(start, start, start, goal)
    execution = execute(plan, Recorded(), look=look, replan=replan)
    assert execution.tied and len(execution.outcomes) == 3 and len(asked) == 2
    config, look = ExecutionConfig(unsolved=1), Scripted(*[start] * 3)
    execution = execute(plan, Recorded(), config, look=look, replan=replan)
    assert execution.reason == "no plan was found after 2 actions: no way"


def test_it_gives_up_after_so_many_actions(plan):
    start = Sight.of(plan.start)
    _, replan = replanned(plan)
    config = ExecutionConfig(max_actions=3)
    execution = execute(plan, Recorded(), config, look=Scripted(*[start] * 4), replan=replan)
    assert len(execution.outcomes) == 3 and execution.tied is False
    assert execution.reason.startswith("the knot is not tied after 3 actions: the rope is seen")


def test_a_knot_in_doubt_is_looked_at_again_and_not_reported(plan):
    unsure = Sight.of(plan.steps[0].end, ("a crossing is in doubt",))
    start = Sight.of(plan.start)
    _, replan = replanned(plan)
    config = ExecutionConfig(pulls=0)
    look = Scripted(start, *[unsure] * 2)
    execution = execute(plan, Recorded(), config, look=look, replan=replan)
    assert execution.tied is False
    assert "in doubt: a crossing is in doubt" in execution.reason
    np.testing.assert_allclose(look.places[1] * [1, -1, 1], look.places[2], atol=1e-9)
    sure = Sight.of(plan.steps[0].end)
    execution = execute(plan, Recorded(), look=Scripted(start, unsure, sure), replan=replan)
    assert execution.tied


def test_nothing_is_planned_from_a_rope_in_doubt(plan):
    unsure = Sight.of(plan.start, ("a crossing is in doubt",))
    asked, replan = replanned(plan)
    look = Scripted(*[unsure] * 6)
    execution = execute(plan, Recorded(), look=look, replan=replan)
    assert asked == [] and execution.outcomes == () and execution.tied is False
    assert execution.reason.startswith("it cannot be planned after 0 actions: ")
    assert look.likely == [[plan.start]] * 6  # what was seen in doubt is not what is likely


def test_a_knot_that_hangs_on_an_end_is_not_reported(plan):
    tied = plan.steps[0].end
    start, hanging = Sight.of(plan.start, ends=(0,)), Sight.of(tied, ends=(-1,))
    _, replan = replanned(plan)
    config, look = ExecutionConfig(pulls=1), Scripted(start, hanging, hanging)
    execution = execute(plan, Recorded(), config, look=look, replan=replan)
    assert execution.tied is False and len(execution.outcomes) == 1
    assert execution.reason.startswith("it cannot be planned after 1 actions: ")
    assert execution.reason.endswith("in doubt: the tail ends at another strand")
    look = Scripted(start, hanging, Sight.of(tied))
    execution = execute(plan, Recorded(), look=look, replan=replan)
    assert execution.tied
    assert execute(plan, Recorded(), look=Scripted(hanging)).tied is False


@pytest.mark.parametrize(("ends", "turn", "end"), [((0,), 1, 0), ((-1,), 0, -1), ((-1, 0), 1, 0)])
def test_the_ends_in_doubt_are_pulled_in_turn(ends, turn, end, plan):
    twin = Twin(plan.start, TwinConfig(level=0), np.random.default_rng(1))
    before = twin.points
    Run(twin.robot(), ExecutionConfig(), points=before).pull(0, ends, turn)
    outward = before[end] - before.mean(axis=0)
    assert 0.02 < (twin.points - before)[end] @ outward / np.linalg.norm(outward) < 0.06


def test_a_rope_in_doubt_is_pulled_apart_and_keeps_its_state(plan):
    step = plan.steps[0]
    twin = Twin(step.end, TwinConfig(level=1), np.random.default_rng(1))
    run = Run(twin.robot(), ExecutionConfig(), points=twin.points)
    before = twin.points
    run.pull(0)
    moved = np.linalg.norm(twin.points - before, axis=1)[[0, -1]]
    assert 0.02 < moved.max() < 0.06
    assert state_or_none(twin.points) == step.end_state
    assert not run.closed and not twin.grasped


def test_a_look_knows_where_the_rope_was_and_where_it_should_be(plan):
    start, end = Sight.of(plan.start), Sight.of(plan.steps[0].end)
    look = Scripted(start, end)
    execute(plan, Recorded(), look=look, replan=replanned(plan)[1])
    np.testing.assert_array_equal(look.likely[0], [plan.start])
    np.testing.assert_array_equal(look.likely[1], [plan.start, plan.steps[0].end])


class Clumsy:
    """A robot whose fingers open by themselves at its n-th move with the rope, once."""

    def __init__(self, twin, at):
        self.twin, self.at, self.moves = twin, at, 0

    def __getattr__(self, name):
        return getattr(self.twin, name)

    def move_to(self, position, seconds):
        self.moves += self.twin.grasped
        if self.moves == self.at:
            self.moves += 1
            self.twin.release()
        self.twin.move_to(position, seconds)


def test_a_rope_that_is_lost_time_and_again_is_given_up(plan):
    twin = twin_of(plan, reach=0.0)
    true, config = TrueState(twin), ExecutionConfig(attempts=2)
    _, replan = replanned(plan)
    execution = execute(plan, twin.robot(), config, true, look=true, replan=replan)
    assert execution.reason.startswith("the rope was lost in 2 actions one after the other")
    assert execution.tied is False


def test_a_rope_that_is_dropped_midway_is_noticed_and_taken_up_again(plan):
    twin = twin_of(plan)
    true = TrueState(twin)
    _, replan = replanned(plan)
    config = ExecutionConfig(max_actions=3)
    execution = execute(plan, Clumsy(twin, 14), config, true, look=true, replan=replan)
    assert not execution.outcomes[0].held
    assert execution.outcomes[0].found != execution.outcomes[0].expected
    assert execution.tied == (state_or_none(twin.points) in plan.goal_states)
    assert len(execution.outcomes) > 1


def test_what_cannot_be_done_is_refused(plan):
    with pytest.raises(ValueError, match="look"):
        execute(plan, Recorded(), replan=lambda points: plan)
    with pytest.raises(ValueError, match="source"):
        execute(plan, Recorded(), controller=object())
    step = replace(plan.steps[0], trajectory=plan.steps[0].trajectory[:0])
    with pytest.raises(ValueError, match="trajectories"):
        execute(replace(plan, steps=(step,)), Recorded())


def test_a_path_from_another_grasp_ends_where_it_was_planned(plan):
    step = plan.steps[0]
    path = from_grasp(step, step.gripper[0] + [0.0, 0.02, 0.0], plan.move_time)
    np.testing.assert_allclose(path[0] - step.gripper[0], [0.0, 0.02, 0.0], atol=1e-6)
    np.testing.assert_allclose(path[-1], step.gripper[-1], atol=1e-6)


def test_a_rope_between_frames_is_interpolated(plan):
    step = plan.steps[0]
    middle = (step.times[3] + step.times[4]) / 2
    wanted = (step.trajectory[3] + step.trajectory[4]) / 2
    ropes = rope_at(step, np.array([middle, step.times[-1]]))
    np.testing.assert_allclose(ropes[0], wanted, atol=1e-6)
    np.testing.assert_allclose(ropes[1], step.trajectory[-1], atol=1e-6)

"""Plans are executed with five words, and a lost rope is noticed."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest

from knotflow.execution import (
    STEP,
    ExecutionConfig,
    Observation,
    TrueState,
    Twin,
    TwinConfig,
    execute,
)
from knotflow.execution.step_executor import StepExecutor, StepOutcome
from knotflow.planning import UnreachableGoalError
from knotflow.simulation import RopeConfig, resample, state_or_none


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


def test_open_loop_follows_the_plan_without_images(plan):
    robot = Recorded()
    execution = execute(plan, robot)
    assert "observe" not in robot.words
    assert [word for word in robot.words if word != "move_to"] == ["grasp", "release", "release"]
    dragged = ~np.isnan(execution.reference[:, 0, 0])
    waypoints = plan.waypoints(1 / STEP)
    drag = waypoints.positions[np.array(waypoints.phases) == "drag"]
    np.testing.assert_allclose(execution.gripper[dragged], drag, atol=1e-3)
    assert execution.closed[dragged].all()
    assert np.isnan(execution.points).all() and execution.ticks == ()
    travel = plan.waypoints(1 / STEP)
    np.testing.assert_allclose(execution.gripper[-len(travel) :], travel.positions, atol=1e-3)


@pytest.mark.slow
def test_nominal_twin_reaches_the_planned_state(plan):
    for source in (False, True):
        twin = twin_of(plan)
        execute(plan, twin.robot(), source=TrueState(twin) if source else None)
        assert state_or_none(twin.points) in plan.goal_states


def test_closed_loop_grasps_a_displaced_rope(plan):
    moved = plan.start + [0.0, 0.04, 0.0]
    twin = Twin(moved, TwinConfig(level=0), np.random.default_rng(1))
    execution = execute(plan, twin.robot(), source=TrueState(twin))
    assert execution.reason == "every step was executed"
    twin = Twin(moved, TwinConfig(level=0), np.random.default_rng(1))
    execute(plan, twin.robot())  # open loop grasps air, and does not know
    np.testing.assert_allclose(twin.points, moved, atol=1e-3)


def test_execution_of_an_unsolved_plan_says_so(plan):
    unsolved = replace(plan, solved=False, reason="max_branches")
    execution = execute(unsolved, twin_of(plan).robot())
    told = "every step was executed of a plan that does not tie the knot"
    assert execution.reason == told


def test_closed_loop_corrects_the_robots_error(plan):
    twin = twin_of(plan, level=2)
    execution = execute(plan, twin.robot(), source=TrueState(twin))
    assert execution.reason == "every step was executed"
    held = np.flatnonzero(execution.closed)
    assert np.linalg.norm(execution.gripper[held[-1]] - plan.steps[0].gripper[-1]) < 1e-3


def test_failed_grasps_end_the_execution(plan):
    twin = twin_of(plan, reach=0.0)
    config = ExecutionConfig(attempts=2)
    execution = execute(plan, twin.robot(), config, TrueState(twin))
    assert execution.reason == "the rope was lost in all 2 attempts at step 0"
    np.testing.assert_allclose(twin.points, plan.start, atol=1e-3)


def test_rope_source_gets_image_position_and_grasp(plan):
    seen = []

    class Source:
        lost = False

        def points(self, robot, grasped):
            seen.append((robot.observe(), robot.position.shape, grasped))
            return plan.start

    execute(plan, Recorded(), ExecutionConfig(slip=10.0), Source())
    assert {one[:2] for one in seen} == {("an image", (3,))}
    assert {one[2] for one in seen} == {False, True}


def test_failing_robot_releases(plan):
    robot = Recorded(fails_at=40)
    with pytest.raises(ConnectionError):
        execute(plan, robot)
    assert robot.words[-1] == "release"


def test_fingers_that_do_not_open_do_not_hide_why_they_should(plan):
    class Jammed(Recorded):
        def release(self):
            raise OSError("gripper not homed")

    with pytest.raises(ConnectionError) as told:
        execute(plan, Jammed(fails_at=1))
    assert told.value.__notes__ == ["the fingers may still be closed: gripper not homed"]


def replanned(plan, **changes):
    """A planner that always answers with the same plan, changed, and what it was asked."""
    asked = []

    def replan(points):
        asked.append(points)
        return replace(plan, **changes)

    return asked, replan


class Scripted:
    """An estimator that answers what it was told to, one observation after the other."""

    def __init__(self, *observations):
        self.observations, self.likely, self.places = list(observations), [], []

    def estimate(self, robot, likely=()):
        self.likely.append(likely)
        self.places.append(robot.position)
        return self.observations.pop(0)


def test_open_loop_reports_no_knot(plan):
    assert execute(plan, Recorded()).tied is None


def test_observed_knot_is_reported(plan):
    twin = twin_of(plan)
    asked, replan = replanned(plan)
    true = TrueState(twin)
    execution = execute(plan, twin.robot(), source=true, estimator=true, replan=replan)
    assert execution.tied
    assert execution.reason == "the knot is seen to be tied after 1 actions"
    assert asked == []  # the rope lay as the plan begins
    (outcome,) = execution.outcomes
    assert outcome.observed_state == plan.steps[0].end_state and outcome.held


def test_replans_from_the_observed_rope_after_each_action(plan):
    start, goal = Observation.of(plan.start), Observation.of(plan.steps[0].end)
    asked, replan = replanned(plan)
    estimator = Scripted(start, start, goal)
    execution = execute(plan, Recorded(), estimator=estimator, replan=replan)
    assert execution.tied and len(execution.outcomes) == 2
    np.testing.assert_array_equal(asked, [plan.start])
    assert [one.observed_state for one in execution.outcomes] == [start.state, goal.state]


def test_replans_from_an_unexpected_first_state(plan):
    goal = Observation.of(plan.steps[0].end)
    elsewhere = replace(plan, goal_states=(plan.start_state,))
    asked, replan = replanned(elsewhere)
    execution = execute(
        elsewhere, Recorded(), estimator=Scripted(goal, Observation.of(plan.start)), replan=replan
    )
    np.testing.assert_array_equal(asked, [goal.points])
    assert execution.tied


def test_replanning_makes_up_for_the_robots_error_without_tracking(plan):
    class Off(Recorded):
        def move_to(self, position, seconds):
            super().move_to(position, seconds)
            self.at = self.at + [0.01, -0.02, 0.0]

    start, goal = Observation.of(plan.start), Observation.of(plan.steps[0].end)
    for replan, off in ((None, np.hypot(0.01, 0.02)), (replanned(plan)[1], 0.0)):
        robot = Off()
        execution = execute(plan, robot, estimator=Scripted(*[start] * 2, goal), replan=replan)
        assert np.linalg.norm(robot.at - execution.gripper[-1]) == pytest.approx(off, abs=1e-9)


def test_a_first_plan_that_ties_nothing_is_not_begun(plan):
    start, goal = Observation.of(plan.start), Observation.of(plan.steps[0].end)
    asked, replan = replanned(plan)
    unsolved = replace(plan, solved=False)
    execution = execute(unsolved, Recorded(), estimator=Scripted(start, goal), replan=replan)
    assert len(asked) == 1 and execution.tied


def test_a_plan_without_steps_ends_the_execution(plan):
    """What ties the knot without a step is tied; the observation says that it is not."""
    start = Observation.of(plan.start)
    _, replan = replanned(plan, steps=(), reason="it is tied")
    execution = execute(plan, Recorded(), estimator=Scripted(start, start), replan=replan)
    assert execution.reason == "no plan was found after 1 actions: it is tied"


def test_a_rope_that_vanishes_is_not_pulled(plan):
    start, nothing = Observation.of(plan.start), Observation(None, None, ("dark",))
    execution = execute(
        plan, Recorded(), estimator=Scripted(start, *[nothing] * 2), replan=replanned(plan)[1]
    )
    assert execution.reason == "the rope is not seen: dark after 1 actions"
    assert execution.tied is False


def test_frames_are_those_after_each_move_of_the_ropes_own_shape(plan):
    finer = resample(plan.start, replace(RopeConfig(), links=48))

    class Resampled:
        """Its rope gets more links after a while."""

        lost, asked = False, 0

        def points(self, robot, grasped):
            self.asked += 1
            return plan.start if self.asked < 4 else finer

    config = ExecutionConfig(slip=10.0, attempts=1)
    execution = execute(plan, Recorded(), config, Resampled())
    np.testing.assert_allclose(execution.times, STEP * np.arange(1, len(execution.gripper) + 1))
    assert execution.points.shape[1:] == plan.start.shape
    seen = ~np.isnan(execution.points[:, 0, 0])
    assert seen.any() and not seen[-1]


def test_missing_plan_ends_the_execution(plan):
    start = Observation.of(plan.start)
    asked, replan = replanned(plan, steps=(), solved=False, reason="no way")
    execution = execute(plan, Recorded(), estimator=Scripted(start, start), replan=replan)
    assert execution.reason == "no plan was found after 1 actions: no way"
    assert len(asked) == 4  # it was searched again before that

    def unreachable(points):
        raise UnreachableGoalError("there is no way")

    execution = execute(plan, Recorded(), estimator=Scripted(start, start), replan=unreachable)
    assert execution.reason == "there is no plan after 1 actions: there is no way"
    assert execution.tied is False


def test_partial_plan_is_begun_and_replanned(plan):
    start, goal = Observation.of(plan.start), Observation.of(plan.steps[0].end)
    asked, replan = replanned(plan, solved=False, reason="no way")
    estimator = Scripted(start, start, start, goal)
    execution = execute(plan, Recorded(), estimator=estimator, replan=replan)
    assert execution.tied and len(execution.outcomes) == 3 and len(asked) == 2
    config, estimator = ExecutionConfig(max_unsolved=1), Scripted(*[start] * 3)
    execution = execute(plan, Recorded(), config, estimator=estimator, replan=replan)
    assert execution.reason == "no plan was found after 2 actions: no way"


def test_max_actions_ends_the_execution(plan):
    start = Observation.of(plan.start)
    _, replan = replanned(plan)
    config = ExecutionConfig(max_actions=3)
    execution = execute(plan, Recorded(), config, estimator=Scripted(*[start] * 4), replan=replan)
    assert len(execution.outcomes) == 3 and execution.tied is False
    assert execution.reason.startswith("the knot is not tied after 3 actions: the rope is seen")


def test_ambiguous_knot_is_observed_again_and_not_reported(plan):
    unsure = Observation.of(plan.steps[0].end, ("a crossing is in doubt",))
    start = Observation.of(plan.start)
    _, replan = replanned(plan)
    config = ExecutionConfig(max_pulls=0)
    estimator = Scripted(start, *[unsure] * 2)
    execution = execute(plan, Recorded(), config, estimator=estimator, replan=replan)
    assert execution.tied is False
    assert "in doubt: a crossing is in doubt" in execution.reason
    np.testing.assert_allclose(estimator.places[1] * [1, -1, 1], estimator.places[2], atol=1e-9)
    sure = Observation.of(plan.steps[0].end)
    execution = execute(plan, Recorded(), estimator=Scripted(start, unsure, sure), replan=replan)
    assert execution.tied


def test_no_plan_from_an_ambiguous_rope(plan):
    unsure = Observation.of(plan.start, ("a crossing is in doubt",))
    asked, replan = replanned(plan)
    estimator = Scripted(*[unsure] * 6)
    execution = execute(plan, Recorded(), estimator=estimator, replan=replan)
    assert asked == [] and execution.outcomes == () and execution.tied is False
    assert execution.reason.startswith("it cannot be planned after 0 actions: ")
    assert estimator.likely == [[plan.start]] * 6  # what was seen in doubt is not what is likely


def test_an_end_is_pulled_only_if_allowed(plan):
    unsure = Observation.of(plan.start, ("a crossing is in doubt",))
    told: list[str] = []

    def allow(motion: str) -> bool:
        told.append(motion)
        return len(told) < 2

    robot, estimator = Recorded(), Scripted(*[unsure] * 4)
    _, replan = replanned(plan)
    execution = execute(plan, robot, estimator=estimator, replan=replan, allow=allow)
    assert execution.tied is False and execution.outcomes == ()
    assert len(told) == 2 and "a crossing is in doubt" in told[0] and "40 mm outward" in told[0]
    assert robot.words.count("grasp") == 1


def test_knot_with_an_ambiguous_end_is_not_reported(plan):
    tied = plan.steps[0].end
    start = Observation.of(plan.start, ambiguous_ends=(0,))
    hanging = Observation.of(tied, ambiguous_ends=(-1,))
    _, replan = replanned(plan)
    config, estimator = ExecutionConfig(max_pulls=1), Scripted(start, hanging, hanging)
    execution = execute(plan, Recorded(), config, estimator=estimator, replan=replan)
    assert execution.tied is False and len(execution.outcomes) == 1
    assert execution.reason.startswith("it cannot be planned after 1 actions: ")
    assert execution.reason.endswith("in doubt: the tail ends at another strand")
    estimator = Scripted(start, hanging, Observation.of(tied))
    execution = execute(plan, Recorded(), estimator=estimator, replan=replan)
    assert execution.tied
    assert execute(plan, Recorded(), estimator=Scripted(hanging)).tied is False


def test_estimator_gets_last_and_expected_shapes(plan):
    start, end = Observation.of(plan.start), Observation.of(plan.steps[0].end)
    estimator = Scripted(start, end)
    execute(plan, Recorded(), estimator=estimator, replan=replanned(plan)[1])
    np.testing.assert_array_equal(estimator.likely[0], [plan.start])
    np.testing.assert_array_equal(estimator.likely[1], [plan.start, plan.steps[0].end])
    at_the_end = Scripted(end)
    execute(plan, Recorded(), estimator=at_the_end)
    np.testing.assert_array_equal(at_the_end.likely, [[plan.steps[0].end]])


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


def test_repeated_losses_end_the_execution(plan):
    twin = twin_of(plan, reach=0.0)
    true, config = TrueState(twin), ExecutionConfig(attempts=2)
    _, replan = replanned(plan)
    execution = execute(plan, twin.robot(), config, true, estimator=true, replan=replan)
    assert execution.reason.startswith("the rope was lost in 2 actions one after the other")
    assert execution.tied is False


def test_dropped_rope_is_detected_and_grasped_again(plan):
    twin = twin_of(plan)
    true = TrueState(twin)
    _, replan = replanned(plan)
    config = ExecutionConfig(max_actions=3)
    execution = execute(plan, Clumsy(twin, 14), config, true, estimator=true, replan=replan)
    assert not execution.outcomes[0].held
    assert execution.outcomes[0].observed_state != plan.steps[0].end_state
    assert execution.tied == (state_or_none(twin.points) in plan.goal_states)
    assert len(execution.outcomes) > 1


def test_losses_and_unsolved_plans_count_only_in_a_row(plan, monkeypatch):
    held, solved = cycle([False, True]), cycle([False, True])

    def step_of(self, step, *_):
        return StepOutcome(step, None, held=next(held), tracked=True)

    monkeypatch.setattr(StepExecutor, "execute", step_of)
    estimator = Scripted(*[Observation.of(plan.start)] * 7)
    config = ExecutionConfig(attempts=2, max_unsolved=1, max_actions=6)
    execution = execute(
        *(plan, Recorded(), config),
        estimator=estimator,
        replan=lambda points: replace(plan, solved=next(solved)),
    )
    assert execution.reason.startswith("the knot is not tied after 6 actions")


def test_inconsistent_arguments_are_refused(plan):
    with pytest.raises(ValueError, match="estimator"):
        execute(plan, Recorded(), replan=lambda points: plan)
    with pytest.raises(ValueError, match="source"):
        execute(plan, Recorded(), controller=object())
    step = replace(plan.steps[0], trajectory=plan.steps[0].trajectory[:0])
    with pytest.raises(ValueError, match="trajectories"):
        execute(replace(plan, steps=(step,)), Recorded())

import json
from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import KnotPlan, PlanFormatError
from knotflow.topology import Arrange


def test_shapes_and_states_go_from_start_to_goal(plan):
    assert len(plan.shapes) == len(plan.states) == len(plan.steps) + 1
    assert plan.splines.shape == (3, 6)
    assert plan.states[-1] in plan.goal_states
    np.testing.assert_array_equal(plan.shapes[0], plan.start)
    np.testing.assert_array_equal(plan.shapes[-1], plan.steps[-1].end)


def test_control_points_lie_where_the_gripper_goes(plan):
    for controls, step in zip(plan.controls, plan.steps, strict=True):
        np.testing.assert_allclose(controls[0], step.gripper[0], atol=1e-6)
        np.testing.assert_allclose(controls[2], step.gripper[-1], atol=1e-6)


def test_json_gives_the_plan_back(plan):
    again = KnotPlan.from_json(plan.to_json())
    for name in ("goal", "goal_states", "solved", "reason", "start_state", "tried", "branches"):
        assert getattr(again, name) == getattr(plan, name)
    for name in ("kept", "seconds"):
        assert getattr(again, name) == getattr(plan, name)
    np.testing.assert_array_equal(again.shapes, plan.shapes)
    np.testing.assert_array_equal(again.splines, plan.splines)
    assert (again.actions, again.states) == (plan.actions, plan.states)
    for one, other in zip(again.steps, plan.steps, strict=True):
        np.testing.assert_array_equal(one.start, other.start)
        np.testing.assert_allclose(one.trajectory, other.trajectory, atol=1e-6)
        np.testing.assert_allclose(one.gripper, other.gripper, atol=1e-6)
    assert again.to_json() == plan.to_json()


def test_an_arranging_step_says_what_for_but_is_no_part_of_the_path(plan):
    first = plan.steps[0]
    arranging = replace(
        first, action=Arrange(first.action), end=first.start, end_state=first.start_state
    )
    longer = replace(plan, steps=(arranging, *plan.steps))
    assert longer.actions == plan.actions
    assert f"arrange for {first.action} {first.start_state}" in longer.summary()
    again = KnotPlan.from_json(longer.to_json())
    assert [step.action for step in again.steps] == [step.action for step in longer.steps]
    assert longer.waypoints().actions[0] == f"arrange for {first.action}"


def test_json_without_trajectories_still_gives_waypoints(plan):
    text = plan.to_json(trajectories=False)
    assert len(text) < len(plan.to_json()) / 3
    again = KnotPlan.from_json(text)
    np.testing.assert_allclose(again.waypoints().positions, plan.waypoints().positions, atol=2e-6)


def test_what_is_no_plan_is_refused(plan):
    data = json.loads(plan.to_json())
    first = data["steps"][0]
    for text, message in [
        ("{", "cannot be read"),
        ("[]", "cannot be read"),
        (json.dumps(data | {"version": 99}), r"\('knotflow.plan', 99\)"),
        (json.dumps({key: data[key] for key in data if key != "start_m"}), "no 'start_m'"),
        (json.dumps(data | {"start_state": "knotty"}), "knotty"),
        (json.dumps(data | {"start_state": None}), "None is not a state's text"),
        (json.dumps(data | {"tried": [1]}), "cannot be read"),
        (json.dumps(data | {"radius_m": None}), "cannot be read"),
        (json.dumps(data | {"steps": [first | {"spline": 1.5}]}), "cannot be read"),
        (json.dumps(data | {"steps": [first | {"times_s": [10**400]}]}), "cannot be read"),
        (json.dumps(data | {"steps": [first | {"end_m": [[0, 0, 0]]}]}), "a step ends with a rope"),
        (json.dumps(data | {"frame": data["frame"] | {"unit": "ft"}}), "unknown unit 'ft'"),
        (json.dumps(data | {"worlds": 16, "survived": []}), "it survived 0 of 3 steps"),
        ("[" * 100_000, "cannot be read"),
    ]:
        with pytest.raises(PlanFormatError, match=message):
            KnotPlan.from_json(text)


def test_the_summary_names_the_path_and_the_size_of_the_tree(plan):
    text = plan.summary()
    assert all(str(action) in text for action in plan.actions)
    assert f"{plan.branches} splines simulated, {plan.kept} kept" in text
    assert "NOT" not in text


def test_steps_are_left_from_where_a_state_is_met_last(plan):
    action = plan.steps[1].action
    before = replace(plan.steps[1], action=Arrange(action), end_state=plan.steps[1].start_state)
    longer = replace(plan, steps=(plan.steps[0], before, *plan.steps[1:]))
    assert longer.steps_from(plan.start_state) == longer.steps
    assert longer.steps_from(plan.steps[1].start_state) == plan.steps[1:]
    assert longer.steps_from(plan.steps[-1].end_state) == ()

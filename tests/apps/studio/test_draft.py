"""Three clicks become a spline, wherever the eye is."""

import numpy as np
import pytest

from knotflow.apps.studio.draft import ClickError, Draft, place_on_rope, place_on_table
from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.simulation import RopeConfig, resample, straight
from knotflow.topology import R1, TopologicalState

ROPE = RopeConfig()
EYES = [(0.0, -0.75, 1.25), (0.6, 0.4, 0.9), (0.0, 0.0, 1.5)]


def look(eye, at):
    """A ray from the eye to a place."""
    return np.array(eye), np.array(at) - np.array(eye)


@pytest.fixture
def draft():
    return Draft(straight(ROPE), TopologicalState.trivial(), R1(0, 1, 1), ROPE)


def on_rope(points, fraction):
    along = np.linspace(0, 1, len(points))
    return np.array([np.interp(fraction, along, column) for column in points.T])


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("number", range(0, 50, 7))
def test_clicks_on_the_control_points_give_the_spline_back(eye, number):
    one = load_demonstrations()[number]
    points = resample(one.points, ROPE)
    draft = Draft(points, one.task.start_state, one.task.action, ROPE, float(one.spline[3]))
    draft.places.append((one.spline[0],))
    for place in (one.spline[1:3], one.spline[4:]):
        draft.click(*look(eye, (*place, ROPE.radius)))
    assert draft.spline == pytest.approx(one.spline, abs=1e-9)


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("fraction", [0.0, 0.031, 0.5, 1.0])
def test_a_click_on_the_rope_finds_where_it_is_grasped(eye, fraction):
    points = straight(ROPE)
    found = place_on_rope(points, *look(eye, on_rope(points, fraction)))
    assert found == pytest.approx(fraction, abs=2e-3)


def test_where_strands_cross_the_upper_one_is_meant():
    # Two strands at right angles, the later one 16 mm above the earlier.
    points = np.array([[-0.3, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0.016], [0, -0.3, 0.016]])
    found = place_on_rope(points, (0, 0, 1.0), (0, 0, -1.0))
    assert found == pytest.approx(0.875, abs=2e-3)


def test_each_click_is_asked_for_and_can_be_taken_back(draft):
    asked = []
    for place in ((0.0, 0.0, 0.008), (0.1, 0.2, 0.0), (0.2, 0.1, 0.0)):
        asked.append(draft.awaits)
        assert len(draft.controls) == len(draft.places)
        draft.click(*look(EYES[0], place))
    assert asked == ["grasp", "middle", "end"]
    assert draft.awaits is None
    draft.undo()
    assert draft.awaits == "end"


def test_what_a_click_cannot_mean_is_refused(draft):
    with pytest.raises(ClickError, match="grasp the rope: that was 20 cm beside it"):
        draft.click(*look((0, 0.2, 1), (0, 0.2, 0)))
    draft.click(*look(EYES[0], (0, 0, 0.008)))
    with pytest.raises(ClickError, match=r"the middle at x \+0.90, y \+0.00 m is out of"):
        draft.click(*look(EYES[0], (0.9, 0.0, 0.008)))
    with pytest.raises(ClickError, match="click the middle first"):
        _ = draft.spline
    assert len(draft.places) == 1


def test_a_click_above_the_horizon_is_no_place_on_the_table():
    for direction in ((0, 1, 0), (0, 1, 0.5)):
        with pytest.raises(ClickError, match="horizon"):
            place_on_table((0, 0, 1), direction)


def test_the_goal_is_where_the_action_leads(draft):
    assert draft.goal == TASKS[0].goal_state

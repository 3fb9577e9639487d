"""Clicks become splines and ropes, wherever the camera is."""

import numpy as np
import pytest

from knotflow.apps.studio.demonstration import (
    ClickError,
    Draft,
    grasp_at,
    rope_from_drawing,
    table_point,
)
from knotflow.planning import RopeInputError
from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.simulation import RopeConfig, check_points, resample, straight
from knotflow.topology import R1, TopologicalState

ROPE = RopeConfig()
LOOP = np.array([[-0.4, 0], [0.2, 0], [0.2, 0.3], [-0.1, 0.3], [-0.1, -0.3]])
CAMERAS = [(0.0, -0.75, 1.25), (0.6, 0.4, 0.9), (0.0, 0.0, 1.5)]


def look(camera, at):
    """A ray from the eye to a place."""
    return np.array(camera), np.array(at) - np.array(camera)


@pytest.fixture
def draft():
    return Draft(straight(ROPE), TopologicalState.trivial(), R1(0, 1, 1), ROPE)


def on_rope(points, fraction):
    along = np.linspace(0, 1, len(points))
    return np.array([np.interp(fraction, along, column) for column in points.T])


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("number", range(0, 50, 7))
def test_clicks_on_control_points_give_the_spline(camera, number):
    one = load_demonstrations()[number]
    points = resample(one.points, ROPE)
    draft = Draft(points, one.task.start_state, one.task.action, ROPE, float(one.spline[3]))
    draft.clicks.append((one.spline[0],))
    for place in (one.spline[1:3], one.spline[4:]):
        draft.click(*look(camera, (*place, ROPE.radius)))
    assert draft.spline == pytest.approx(one.spline, abs=1e-9)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("fraction", [0.0, 0.031, 0.5, 1.0])
def test_click_on_rope_gives_grasp(camera, fraction):
    points = straight(ROPE)
    found = grasp_at(points, *look(camera, on_rope(points, fraction)))
    assert found == pytest.approx(fraction, abs=2e-3)


def test_click_on_crossing_grasps_upper_strand():
    # Two strands at right angles, the later one 16 mm above the earlier.
    points = np.array([[-0.3, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0.016], [0, -0.3, 0.016]])
    found = grasp_at(points, (0, 0, 1.0), (0, 0, -1.0))
    assert found == pytest.approx(0.875, abs=2e-3)


def test_clicks_are_requested_in_order_and_undone(draft):
    asked = []
    for place in ((0.0, 0.0, 0.008), (0.1, 0.2, 0.0), (0.2, 0.1, 0.0)):
        asked.append(draft.next_click)
        assert len(draft.controls) == len(draft.clicks)
        draft.click(*look(CAMERAS[0], place))
    assert asked == ["grasp", "middle", "end"]
    assert draft.next_click is None
    draft.undo()
    assert draft.next_click == "end"


def test_meaningless_clicks_are_refused(draft):
    with pytest.raises(ClickError, match="grasp the rope: that was 20 cm beside it"):
        draft.click(*look((0, 0.2, 1), (0, 0.2, 0)))
    draft.click(*look(CAMERAS[0], (0, 0, 0.008)))
    with pytest.raises(ClickError, match=r"the middle at x \+0.90, y \+0.00 m is out of"):
        draft.click(*look(CAMERAS[0], (0.9, 0.0, 0.008)))
    with pytest.raises(ClickError, match="click the middle first"):
        _ = draft.spline
    assert len(draft.clicks) == 1


def test_click_above_horizon_is_refused():
    for direction in ((0, 1, 0), (0, 1, 0.5)):
        with pytest.raises(ClickError, match="horizon"):
            table_point((0, 0, 1), direction)


def test_the_goal_is_where_the_action_leads(draft):
    assert draft.goal == TASKS[0].goal_state


def test_drawn_line_is_a_centred_rope():
    points = rope_from_drawing([[0.0, 0.0], [0.3, 0.3]], ROPE)
    check_points(points, ROPE)
    assert TopologicalState.from_curve(points) == TopologicalState.trivial()
    assert points[0, :2] == pytest.approx(-points[-1, :2], abs=1e-3)


def test_later_strand_of_drawing_is_on_top():
    points = rope_from_drawing(LOOP, ROPE)
    check_points(points, ROPE)
    assert TopologicalState.from_curve(points) == TopologicalState.trivial().apply(R1(0, 1, 1))


def test_mirrored_drawing_has_mirrored_sign():
    points = rope_from_drawing(LOOP * (1, -1), ROPE)
    state = TopologicalState.from_curve(points)
    assert state.crossings == ((2, 1, -1),)


@pytest.mark.parametrize(
    ("clicked", "message"),
    [
        (np.zeros((0, 2)), "at least two points"),
        ([[0, 0]], "at least two points"),
        ([[0, 0], [0.01, 0]], "the drawing is 0.01 m long"),
        ([[0, 0], [0.3, 0], [0.0, 0.002]], "bends|crossings|apart"),
    ],
)
def test_impossible_drawings_are_refused(clicked, message):
    with pytest.raises(RopeInputError, match=message):
        rope_from_drawing(clicked, ROPE)

import csv
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

from knotflow.planning import Frame, GripperConfig, HandConfig, Placement
from knotflow.planning.fingers import openings
from knotflow.simulation import grasped_link, spline_path

ORDER = ["travel", "descend", "close", "drag", "open", "rise"]


def runs(values):
    """The values without repetitions."""
    return [value for k, value in enumerate(values) if k == 0 or values[k - 1] != value]


@pytest.mark.parametrize("rate", [7.0, 20.0, 100.0])
def test_waypoints_are_evenly_spaced_and_go_through_all_phases(plan, rate):
    waypoints = plan.waypoints(rate)
    np.testing.assert_allclose(np.diff(waypoints.times), 1 / rate)
    assert waypoints.times[0] == 0.0
    assert runs(waypoints.phases) == ORDER * len(plan.steps)
    assert runs(waypoints.step.tolist()) == [0, 1, 2]
    assert runs(waypoints.actions) == [str(action) for action in plan.actions]


def test_the_gripper_is_closed_while_it_drags_and_moves_only_then(plan):
    waypoints = plan.waypoints(50.0)
    phases = np.array(waypoints.phases)
    np.testing.assert_array_equal(waypoints.closed, np.isin(phases, ["close", "drag"]))
    speed = np.linalg.norm(np.diff(waypoints.positions, axis=0), axis=1)
    # It stands still while it closes and while it lets go.
    assert speed[np.isin(phases[1:], ["close", "open"])].max() == 0.0


def test_the_gripper_drags_along_the_spline(plan):
    waypoints = plan.waypoints(100.0)
    phases = np.array(waypoints.phases)
    for index, controls in enumerate(plan.controls):
        drag = waypoints.positions[(phases == "drag") & (waypoints.step == index)]
        path = spline_path(controls, np.linspace(0, 1, 2001))
        off = np.linalg.norm(drag[:, None] - path[None], axis=-1).min(axis=1)
        assert off.max() < 1e-2  # at corners, between frames a tenth of a second apart
        np.testing.assert_allclose(drag[-1], controls[2], atol=1e-6)
        close = waypoints.positions[(phases == "close") & (waypoints.step == index)]
        np.testing.assert_allclose(close[0], controls[0], atol=1e-6)
        assert len(drag) == round(plan.steps[0].release_time * 100.0)


def test_it_lets_go_where_the_drag_ends_between_frames_too(plan):
    early = replace(plan.steps[0], release_time=plan.steps[0].release_time - 0.05)
    waypoints = replace(plan, steps=(early,)).waypoints(20.0)
    last = max(row for row, phase in enumerate(waypoints.phases) if phase == "drag")
    np.testing.assert_allclose(waypoints.positions[last], early.gripper[-1], atol=1e-6)


def test_open_it_stays_above_the_rope_but_straight_over_grasp_and_release(plan):
    config = GripperConfig(approach_height=0.12, retreat_height=0.2)
    waypoints = plan.waypoints(50.0, config)
    phases = np.array(waypoints.phases)
    travel = waypoints.positions[phases == "travel"]
    assert travel[:, 2].min() >= 0.12 - 1e-12
    for phase, point in (("descend", 0), ("rise", 2)):
        for index, controls in enumerate(plan.controls):
            places = waypoints.positions[(phases == phase) & (waypoints.step == index)]
            np.testing.assert_allclose(
                places[:, :2], controls[point, None, :2].repeat(len(places), 0), atol=1e-6
            )
    rises = waypoints.positions[phases == "rise"]
    assert rises[-1, 2] == pytest.approx(0.2)


def test_speeds_stay_within_their_limits(plan):
    config = GripperConfig(travel_speed=0.2, vertical_speed=0.05)
    waypoints = plan.waypoints(100.0, config)
    phases = np.array(waypoints.phases[1:])
    speed = np.linalg.norm(np.diff(waypoints.positions, axis=0), axis=1) * 100.0
    assert speed[phases == "travel"].max() <= 0.2 + 1e-9
    assert speed[np.isin(phases, ["descend", "rise"])].max() <= 0.05 + 1e-9


def test_a_gripper_that_would_touch_the_rope_is_refused(plan):
    for name in ("approach_height", "retreat_height"):
        with pytest.raises(ValueError, match=f"{name}.*take at least"):
            plan.waypoints(20.0, GripperConfig(**{name: 0.02}))


def test_by_default_the_gripper_travels_as_high_as_the_rope_needs(plan):
    large = plan.placed(Placement(40 * 0.005 / plan.radius), Frame())
    with pytest.raises(ValueError, match="approach_height"):
        large.waypoints(20.0, GripperConfig())
    waypoints = large.waypoints()
    travel = waypoints.positions[np.array(waypoints.phases) == "travel"]
    assert travel[:, 2].min() > large.shapes[..., 2].max() + large.radius


def test_where_z_is_not_up_strands_are_written_as_directions(plan):
    turn = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # up is the file's y
    waypoints, text = plan.waypoints(), StringIO()
    waypoints.to_csv(text, Frame(turn))
    rows = list(csv.DictReader(StringIO(text.getvalue())))
    assert "yaw_rad" not in rows[0]
    found = np.array([[float(row[f"strand_{axis}"]) for axis in "xyz"] for row in rows])
    yaws = waypoints.yaws
    wanted = np.stack([np.cos(yaws), np.sin(yaws), 0 * yaws], axis=1) @ turn.T
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_fingers_open_as_wide_as_neighbours_allow(plan):
    waypoints, most = plan.waypoints(50.0), HandConfig().opening
    phases, step = np.array(waypoints.phases), waypoints.step
    assert (waypoints.openings[np.isin(phases, ["drag"])] == 0.0).all()
    links, hand = plan.shapes.shape[1] - 1, HandConfig()
    for number, one in enumerate(plan.steps):
        link = [int(grasped_link(one.spline, links))]
        for phase, shape in (("descend", number), ("rise", number + 1)):
            (room,) = openings(plan.shapes[shape], link, plan.radius, hand)
            width = max(room, 2 * (plan.radius + hand.clearance))
            own = waypoints.openings[(phases == phase) & (step == number)]
            np.testing.assert_allclose(own, width)
    assert 2 * plan.radius < waypoints.openings[phases != "drag"].max() <= most
    assert np.abs(np.diff(waypoints.openings)).max() <= most / (50.0 * 0.5) + 1e-9  # gradually


def test_a_plan_without_steps_has_no_waypoints(plan):
    assert len(replace(plan, steps=()).waypoints()) == 0


def test_senseless_numbers_are_refused(plan):
    with pytest.raises(ValueError, match="rate"):
        plan.waypoints(0.0)
    with pytest.raises(ValueError, match="travel_speed"):
        GripperConfig(travel_speed=0.0)
    with pytest.raises(ValueError, match="open_time"):
        GripperConfig(open_time=-1.0)


def test_the_csv_holds_every_waypoint(plan, tmp_path):
    waypoints = plan.waypoints(20.0)
    waypoints.to_csv(tmp_path / "waypoints.csv")
    with (tmp_path / "waypoints.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]] == "time_s x_m y_m z_m yaw_rad opening_m closed step action phase".split()
    assert len(rows) == len(waypoints)
    read = np.array([[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in rows])
    np.testing.assert_allclose(read, waypoints.positions, atol=1e-6)
    assert [row["closed"] == "1" for row in rows] == waypoints.closed.tolist()
    assert [row["action"] for row in rows] == list(waypoints.actions)


def test_yaw_is_the_grasped_strands_and_turns_with_the_frame(plan):
    waypoints, turned = plan.waypoints(20.0), StringIO()
    for number, step in enumerate(plan.steps):
        link = grasped_link(step.spline, len(step.start) - 1)
        x, y, _ = step.start[link + 1] - step.start[link]
        np.testing.assert_allclose(waypoints.yaws[waypoints.step == number], np.arctan2(y, x))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    waypoints.to_csv(turned, Frame(quarter))
    read = [float(row["yaw_rad"]) for row in csv.DictReader(StringIO(turned.getvalue()))]
    np.testing.assert_allclose(np.cos(read - waypoints.yaws - np.pi / 2), 1.0, atol=1e-6)


@pytest.mark.parametrize("speed", [0.1, 0.25])
def test_a_slower_drag_keeps_the_path_and_its_speed_limit(plan, speed):
    waypoints = plan.waypoints(50.0, GripperConfig(drag_speed=speed))
    fast = plan.waypoints(400.0)
    for step in range(len(plan.steps)):
        slow, quick = (
            one.positions[(np.array(one.phases) == "drag") & (one.step == step)]
            for one in (waypoints, fast)
        )
        assert np.linalg.norm(np.diff(slow, axis=0), axis=1).max() * 50.0 <= speed * (1 + 1e-9)
        assert len(slow) > plan.steps[0].release_time * 50.0
        off = np.linalg.norm(slow[:, None] - quick[None], axis=-1).min(axis=1)
        assert off.max() < 5e-3  # the quick one's points are up to a centimetre apart
        np.testing.assert_array_equal(slow[-1], quick[-1])

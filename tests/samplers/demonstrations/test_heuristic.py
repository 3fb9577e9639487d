"""The aimed guess keeps to the strategy of Sec. V-A."""

import sys

import numpy as np
import pytest

from knotflow.samplers.demonstrations import (
    TASKS,
    arranging_splines,
    heuristic_any_action,
    heuristic_splines,
    task,
)
from knotflow.samplers.demonstrations.heuristic import small_moves
from knotflow.simulation import (
    RopeConfig,
    attempt,
    check_splines,
    control_points,
    random_curve,
    reach_starts,
    straight,
)
from knotflow.topology import R1, TopologicalState, parse_action, segment_intervals


@pytest.mark.slow
@pytest.mark.parametrize("name", ["R1(0,1,1)", "R2(0,0,1,1)"])
def test_it_reaches_untangled_actions_now_and_then(simulator, rng, name):
    points = straight(simulator.config.rope)
    one = task(name)
    splines = heuristic_splines(points, one.action, 64, rng)
    assert attempt(simulator, points, splines, one.action, one.start_state).success.any()


@pytest.mark.slow
def test_it_grasps_the_segment_that_will_be_over(simulator, rng):
    one = task("C(0,2,1)")
    points = reach_starts(one.start_actions, 1, simulator, heuristic_splines, rng).points[0]
    segments = segment_intervals(points)
    for other in TASKS:
        if other.start_state != one.start_state:
            continue
        splines = check_splines(heuristic_splines(points, other.action, 50, rng))
        low, high = segments[other.action.over_segment]
        assert ((splines[:, 0] >= low) & (splines[:, 0] <= high)).all()


def test_it_is_the_same_for_the_same_seed_and_in_range():
    rope = random_curve_of_default_rope()
    one, other = (
        heuristic_splines(rope, TASKS[0].action, 20, np.random.default_rng(1)) for _ in range(2)
    )
    assert np.array_equal(one, other)
    check_splines(one)


def test_nudges_are_short_and_low_and_begin_anywhere(rng):
    points = straight(RopeConfig())
    splines = check_splines(small_moves(points, 400, rng))
    controls = control_points(points, splines, RopeConfig().radius)
    moved = np.linalg.norm(controls[:, 2, :2] - controls[:, 0, :2], axis=1)
    assert 0.05 < np.median(moved) < 0.15
    assert splines[:, 3].max() <= 0.15
    assert np.histogram(splines[:, 0], bins=4, range=(0, 1))[0].min() > 60


def test_what_may_make_room_moves_the_strands_that_the_action_is_about(rng):
    """Of a rope with a loop, C(0,1,1) lays its head over the loop: both are moved, and the head's
    tip is brought to where the loop is."""
    turn = np.linspace(-4.0, 2.2, 60)
    points = np.stack([0.1 * turn - 0.12 * np.sin(turn), -0.12 * np.cos(turn), 0 * turn], axis=1)
    points[:38, 2] = 0.02
    assert TopologicalState.from_curve(points).num_crossings == 1
    action = parse_action("C(0,1,1)")
    head, loop, tail = segment_intervals(points)
    grasp, *_, x, y = check_splines(arranging_splines(points, action, 400, rng)).T
    aimed = slice(300)  # the others are nudges
    assert (grasp[aimed] < tail[0]).all()
    assert (grasp[aimed] > loop[0]).mean() > 0.3
    of_tip = np.flatnonzero(grasp[aimed] < 0.15 * head[1])
    assert len(of_tip) > 60
    on_loop = points[(np.linspace(0, 1, 60) > loop[0]) & (np.linspace(0, 1, 60) < loop[1])]
    apart = np.linalg.norm(np.stack([x, y], 1)[of_tip, None] - on_loop[:, :2], axis=2).min(1)
    assert 0.3 < (apart < 0.12).mean() < 0.9
    (undo, _), *_ = TopologicalState.from_curve(points).undo_actions()
    low, high = segment_intervals(points)[undo.pulled_segment(3)]
    grasp = check_splines(arranging_splines(points, undo, 40, rng))[:30, 0]
    assert ((grasp >= low) & (grasp <= high)).all()


def random_curve_of_default_rope():
    return random_curve(RopeConfig(), np.random.default_rng(0))


def test_anywhere_is_at_an_action_that_leaves_few_enough_crossings(monkeypatch, rng):
    rope, aimed_at = random_curve_of_default_rope(), []
    monkeypatch.setattr(
        sys.modules["knotflow.samplers.demonstrations.heuristic"],
        "heuristic_splines",
        lambda points, action, *others: aimed_at.append(action) or np.zeros((1, 6)),
    )
    trivial = TopologicalState.trivial()
    for _ in range(40):
        heuristic_any_action(rope, trivial, rng, most_crossings=1)
    assert {type(action) for action in aimed_at} == {R1}
    for most, share in [(0, 0.0), (None, 1.0)]:  # no action does; every spline is random
        check_splines(heuristic_any_action(rope, trivial, rng, share, most)[None])
    assert len(aimed_at) == 40

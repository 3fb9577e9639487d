"""Knot types, named by us and by topoly."""

from __future__ import annotations

import os
from collections import deque

import numpy as np
import pytest
import topoly

from knotflow.topology import KNOT_NAMES, Cross, TopologicalState, knot
from knotflow.topology.draw import draw


@pytest.fixture(autouse=True)
def descriptor_0():
    """topoly closes it, see `knotflow.planning.homfly`."""
    kept = os.dup(0)
    yield
    os.dup2(kept, 0)
    os.close(kept)


def homfly_of_diagram(state):
    """HOMFLY polynomial, as topoly prints it, of the knot that joining two ends makes.

    The ends must share a face. Edge p of the planar diagram code arrives at position p.
    """
    count = 2 * state.num_crossings
    terms = []
    for over, under, sign in state.crossings:
        over_out, under_out = over % count + 1, under % count + 1
        beside = (over_out, over) if sign > 0 else (over, over_out)
        terms.append(f"X[{under},{beside[0]},{under_out},{beside[1]}]")
    # topoly forks a process pool unless told not to, and a fork beside threads may hang.
    return topoly.homfly(";".join(terms), translate=False, run_parallel=False)


def homfly_of_curve(points):
    """HOMFLY polynomial of a rope shape whose ends are joined high above everything."""
    above = points[[-1, 0]] + np.array([0.0, 0.0, 0.5])
    polyline = np.concatenate((points, above)).tolist()
    return topoly.homfly(
        polyline, closure=topoly.Closure.CLOSED, translate=False, run_parallel=False
    )


def joined_above(state):
    """The state after leading the tail over everything into the face of the head."""
    queue = deque([state])
    while True:
        state = queue.popleft()
        planar_map = state.planar_map
        if planar_map.left[0] == planar_map.left[planar_map.tail]:
            return state
        tail = planar_map.tail
        queue.extend(
            following
            for action, following in state.actions()
            if isinstance(action, Cross) and action.over == tail and action.under != 0
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rolfsen", "count"),
    [("overhand", "3_1", 4), ("figure_eight", "4_1", 8), ("pentagram", "5_1", 4)]
    + [("three_twist", "5_2", 20)],
)
def test_named_knots_are_the_knots_of_the_tables(name, rolfsen, count):
    states = knot(name)
    assert len(states) == count
    assert {state.num_crossings for state in states} == {int(rolfsen[0])}
    for state in sorted(states)[:: max(1, count // 2)]:
        count_edges = 2 * state.num_crossings
        assert state.planar_map.left[0] == state.planar_map.left[count_edges]
        assert homfly_of_diagram(state) == homfly_of_curve(draw(state, gap=0.05))
    points = draw(min(states), gap=0.05)
    closed = np.concatenate((points, points[[-1, 0]] + [0.0, 0.0, 0.5])).tolist()
    found = topoly.alexander(closed, closure=topoly.Closure.CLOSED, run_parallel=False)
    assert found == rolfsen


def test_names_are_closed_under_the_symmetries():
    for name in KNOT_NAMES:
        states = knot(name)
        assert {state.mirrored() for state in states} == states
        assert {state.reversed() for state in states} == states


@pytest.mark.slow
def test_figure_eights_are_all_the_four_crossing_ones(states_by_crossings):
    # Alternating, reduced, and with both ends in one face: the only such knot is 4_1.
    found = set()
    for state in states_by_crossings[3]:
        for _, following in state.actions():
            planar_map = following.planar_map
            overs = [over % 2 for over, _, _ in following.crossings]
            alternating = len(set(overs)) == 1
            joined = planar_map.left[0] == planar_map.left[planar_map.tail]
            reduced = all(
                planar_map.left[segment] != planar_map.right[segment]
                for segment in range(1, planar_map.tail)
            ) and not any(len(face) == 1 for face in planar_map.faces)
            # A crossing of the two end segments is a loop once the ends are joined.
            reduced &= {1, planar_map.tail} not in [{o, u} for o, u, _ in following.crossings]
            if following.num_crossings == 4 and alternating and joined and reduced:
                found.add(following)
    assert found == knot("figure_eight")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_closed_knot_type_agrees_with_topoly(random_state, seed):
    state = random_state(5 + seed % 2, seed)
    assert homfly_of_diagram(joined_above(state)) == homfly_of_curve(draw(state, gap=0.05))


@pytest.mark.slow
def test_chirality_shows():
    left, right = (TopologicalState.parse(text) for text in ("4o1-2o5-6o3-", "4o1+2o5+6o3+"))
    assert homfly_of_diagram(left) != homfly_of_diagram(right)
    assert homfly_of_diagram(right) == homfly_of_diagram(TopologicalState.parse("1o4+5o2+3o6+"))


def test_the_unknot_is_the_trivial_state():
    assert knot("unknot") == {TopologicalState.trivial()}


def test_an_unknown_name_lists_the_valid_ones():
    with pytest.raises(ValueError, match="'bowline'.*overhand, figure_eight, pentagram"):
        knot("bowline")

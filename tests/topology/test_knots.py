"""Knot types compared with topoly's, and solution graphs."""

from __future__ import annotations

import os
from collections import deque

import networkx as nx
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from knotflow.topology import (
    CATALOGUE,
    KNOT_NAMES,
    Cross,
    TopologicalState,
    is_knot_name,
    knot,
    parse_action,
    solution_graph,
)
from knotflow.topology.draw import draw


@pytest.fixture(autouse=True)
def restore_stdin():
    """topoly closes it."""
    kept = os.dup(0)
    yield
    os.dup2(kept, 0)
    os.close(kept)


def homfly_of_diagram(state):
    """HOMFLY polynomial, as topoly prints it, of the knot that joining two ends makes.

    The ends must share a face. Edge p of the planar diagram code arrives at position p.
    """
    topoly = pytest.importorskip("topoly")
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
    topoly = pytest.importorskip("topoly")
    above = points[[-1, 0]] + np.array([0.0, 0.0, 0.5])
    polyline = np.concatenate((points, above)).tolist()
    return topoly.homfly(
        polyline, closure=topoly.Closure.CLOSED, max_cross=40, translate=False, run_parallel=False
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
    + [("three_twist", "5_2", 20), ("stevedore", "6_1", 24), ("6_2", "6_2", 48)]
    + [("6_3", "6_3", 48)],
)
def test_named_knots_have_their_rolfsen_type(name, rolfsen, count):
    topoly = pytest.importorskip("topoly")
    states = knot(name)
    assert len(states) == count
    assert {state.num_crossings for state in states} == {int(rolfsen[0])}
    for state in sorted(states)[:: max(1, count // 2)]:
        count_edges = 2 * state.num_crossings
        assert state.planar_map.left[0] == state.planar_map.left[count_edges]
        assert homfly_of_diagram(state) == homfly_of_curve(draw(state, gap=0.05))
    points = draw(min(states), gap=0.05)
    closed = np.concatenate((points, points[[-1, 0]] + [0.0, 0.0, 0.5])).tolist()
    how = {"closure": topoly.Closure.CLOSED, "max_cross": 40, "run_parallel": False}
    found = topoly.alexander(closed, **how)
    assert found == rolfsen


def test_knots_are_closed_under_symmetries():
    for name in KNOT_NAMES:
        states = knot(name)
        assert {state.mirrored() for state in states} == states
        assert {state.reversed() for state in states} == states


@pytest.mark.slow
def test_figure_eight_states_are_complete(states_by_crossings):
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
def test_mirror_images_have_different_types():
    left, right = (TopologicalState.parse(text) for text in ("4o1-2o5-6o3-", "4o1+2o5+6o3+"))
    assert homfly_of_diagram(left) != homfly_of_diagram(right)
    assert homfly_of_diagram(right) == homfly_of_diagram(TopologicalState.parse("1o4+5o2+3o6+"))


@pytest.mark.slow
def test_a_slip_knot_is_an_overhand_with_a_bight_and_comes_undone():
    unknotted = homfly_of_curve(draw(TopologicalState.parse("2o1+"), gap=0.05))
    for state in sorted(knot("slip_knot"))[::5]:
        assert homfly_of_curve(draw(state, gap=0.05)) == unknotted
        pulled = {before for _, before in state.predecessors()}  # the bight is drawn back
        assert any(before.num_crossings == 3 for before in pulled)
    assert knot("noose") == knot("slip_knot")


def bowline():
    """A bowline as sailors tie it (V, 3), standing part first."""
    standing, loop_crossing = [(1.2, 3.0, 0.0), (0.6, 1.9, 0.0)], (0.0, 1.2, 0.0)
    small_loop = [(-0.8, 0.4, 0.0), (-0.6, -0.7, 0.0), (0.0, -1.0, 0.0), (0.6, -0.7, 0.0)]
    small_loop += [(0.8, 0.4, 0.0), (0.0, 1.2, 0.6), (-0.9, 2.0, 0.0)]  # over the standing part
    large_loop = [(-2.2, 1.5, 0.0), (-2.5, -1.0, 0.0), (-2.0, -3.5, 0.0), (0.0, -4.2, 0.0)]
    up = [(1.0, -3.2, 0.0), (0.3, -1.0, -0.6), (0.3, -0.2, 0.0)]  # through it from below
    around = [(0.8, 0.75, 0.6), (1.15, 1.5, 0.0), (0.55, 1.9, -0.6), (0.0, 2.0, 0.2)]
    down = [(-0.45, 1.65, 0.6), (-0.75, 1.1, 0.4), (-0.5, 0.7, 0.6), (-0.15, 0.0, 0.0)]
    down += [(-0.1, -1.0, -0.6), (-0.2, -3.0, 0.0)]  # and back through the small loop
    corners = np.array([*standing, loop_crossing, *small_loop, *large_loop, *up, *around, *down])
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    return PchipInterpolator(along, corners)(np.linspace(0.0, along[-1], 400))


def test_a_bowline_is_tied_as_sailors_tie_it():
    assert TopologicalState.from_curve(bowline()) in knot("bowline")
    assert len(knot("bowline")) == 8
    assert {state.num_crossings for state in knot("bowline")} == {7}


@pytest.mark.slow
def test_all_diagrams_of_a_bowline_are_of_one_knot():
    # With its ends joined above, 6_3, which is its own mirror image.
    types = {homfly_of_curve(draw(state, gap=0.05)) for state in knot("bowline")}
    assert types == {homfly_of_curve(bowline())} == {homfly_of_diagram(min(knot("6_3")))}


def test_names_are_unique_and_aliases_name_the_same():
    names = [name for one in CATALOGUE for name in (one.name, *one.aliases)]
    assert len(names) == len(set(names)) and all(map(is_knot_name, names))
    assert knot("5_1") == knot("double_overhand") == knot("pentagram")
    with pytest.raises(ValueError, match="unknown knot 'granny'; valid names: .*overhand, 3_1"):
        knot("granny")


def test_unknot_is_trivial():
    assert knot("unknot") == {TopologicalState.trivial()}


def test_unknown_knot_name_lists_valid_names():
    with pytest.raises(ValueError, match="'sheepshank'.*overhand, 3_1, trefoil, figure_eight"):
        knot("sheepshank")


def solution_paths(graph, goal):
    """The paths of a solution graph from the trivial state to a goal, as (action, state) steps."""
    if goal.num_crossings == 0:
        yield ()
    for previous, _, action in graph.in_edges(goal, data="action"):
        for path in solution_paths(graph, previous):
            yield (*path, (action, goal))


@pytest.mark.parametrize(("name", "paths"), [("overhand", 4), ("pentagram", 16)])
def test_number_of_paths(name, paths):
    for goal in knot(name):
        found = list(solution_paths(solution_graph(goal), goal))
        assert len(found) == len(set(found)) == paths
        for path in found:
            kinds = [action.symbol for action, _ in path]
            assert kinds == ["R1"] + ["C"] * (goal.num_crossings - 1)


def test_overhand_paths_of_fig_1():
    goal = TopologicalState.parse("4o1+2o5+6o3+")
    texts = {
        tuple(str(action) for action, _ in path)
        for path in solution_paths(solution_graph(goal), goal)
    }
    assert ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)") in texts
    assert ("R1(0,1,1)", "C(1,2,1)", "C(4,2,1)") in texts


def test_pentagram_is_two_actions_from_overhand():
    pentagram = TopologicalState.parse("4o1+2o5+6o3+")
    for text in ("C(0,3,1)", "C(4,0,1)"):
        pentagram = pentagram.apply(parse_action(text))
    assert pentagram in knot("pentagram")
    assert TopologicalState.parse("4o1+2o5+6o3+") in solution_graph(pentagram)


def test_solution_graph_is_complete(states_by_crossings):
    # Forward, by brute force, from every state with fewer crossings.
    for goal in sorted(states_by_crossings[3])[::50]:
        graph = solution_graph(goal)
        assert nx.is_directed_acyclic_graph(graph)
        leading = {goal}
        for states in reversed(states_by_crossings[:3]):
            for state in states:
                for action, following in state.actions():
                    if following in leading or following in graph:
                        assert graph.has_edge(state, following, key=str(action))
                        leading.add(state)
        assert set(graph) == leading
        trivial = TopologicalState.trivial()
        for state in graph:
            assert state == goal or nx.has_path(graph, state, goal)
            assert nx.has_path(graph, trivial, state)


def test_edges_carry_their_action(random_state):
    goal = random_state(6, 1)
    graph = solution_graph(goal)
    assert graph.number_of_edges() > 0
    for state, following, action in graph.edges(data="action"):
        assert state.apply(action) == following


def test_paths_lead_from_trivial_to_goal(random_state):
    goal = random_state(5, 2)
    for path in solution_paths(solution_graph(goal), goal):
        state = TopologicalState.trivial()
        for action, following in path:
            state = state.apply(action)
            assert state == following
        assert state == goal


def test_ten_crossing_graphs_are_small(random_state):
    torus = TopologicalState.from_crossings(
        [
            (position + 9, position, 1) if position % 2 else (position, position + 9, 1)
            for position in range(1, 10)
        ]
    )
    assert len(solution_graph(torus)) == 18
    for seed in range(4):
        assert len(solution_graph(random_state(10, seed))) < 1000


def test_several_goals_share_one_graph():
    goals = knot("overhand")
    graph = solution_graph(*goals)
    assert goals <= set(graph)
    for goal in goals:
        assert len(list(solution_paths(graph, goal))) == 4
        assert graph.out_degree(goal) == 0


def test_trivial_goal_needs_no_action():
    trivial = TopologicalState.trivial()
    graph = solution_graph(trivial)
    assert list(graph) == [trivial]
    assert list(solution_paths(graph, trivial)) == [()]

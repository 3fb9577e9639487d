"""Solution graphs: complete, acyclic, and with the paper's numbers of paths."""

from __future__ import annotations

import networkx as nx
import pytest

from knotflow.topology import (
    TopologicalState,
    knot,
    parse_action,
    solution_graph,
    solution_paths,
)


@pytest.mark.parametrize(("name", "paths"), [("overhand", 4), ("pentagram", 16)])
def test_numbers_of_paths_of_the_papers_knots(name, paths):
    for goal in knot(name):
        found = list(solution_paths(solution_graph(goal), goal))
        assert len(found) == len(set(found)) == paths
        for path in found:
            kinds = [action.symbol for action, _ in path]
            assert kinds == ["R1"] + ["C"] * (goal.num_crossings - 1)


def test_the_overhand_paths_of_fig_1_are_found():
    goal = TopologicalState.parse("4o1+2o5+6o3+")
    texts = {
        tuple(str(action) for action, _ in path)
        for path in solution_paths(solution_graph(goal), goal)
    }
    assert ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)") in texts
    assert ("R1(0,1,1)", "C(1,2,1)", "C(4,2,1)") in texts


def test_the_pentagram_is_two_steps_from_an_overhand():
    pentagram = TopologicalState.parse("4o1+2o5+6o3+")
    for text in ("C(0,3,1)", "C(4,0,1)"):
        pentagram = pentagram.apply(parse_action(text))
    assert pentagram in knot("pentagram")
    assert TopologicalState.parse("4o1+2o5+6o3+") in solution_graph(pentagram)


def test_the_graph_holds_exactly_the_action_paths(states_by_crossings):
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


def test_edges_carry_the_action_that_takes_them(random_state):
    goal = random_state(6, 1)
    graph = solution_graph(goal)
    assert graph.number_of_edges() > 0
    for state, following, action in graph.edges(data="action"):
        assert state.apply(action) == following


def test_every_path_leads_from_trivial_to_the_goal(random_state):
    goal = random_state(5, 2)
    for path in solution_paths(solution_graph(goal), goal):
        state = TopologicalState.trivial()
        for action, following in path:
            state = state.apply(action)
            assert state == following
        assert state == goal


def test_ten_crossings_stay_small(random_state):
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


def test_the_trivial_goal_needs_no_action():
    trivial = TopologicalState.trivial()
    graph = solution_graph(trivial)
    assert list(graph) == [trivial]
    assert list(solution_paths(graph, trivial)) == [()]


def test_what_is_no_goal_is_refused():
    with pytest.raises(TypeError, match="at least one goal"):
        solution_graph()
    with pytest.raises(TypeError, match="knot by name"):
        solution_graph("overhand")
    graph = solution_graph(TopologicalState.trivial())
    with pytest.raises(ValueError, match="not in this solution graph"):
        next(solution_paths(graph, TopologicalState.parse("2o1+")))

"""The search graph: with undoing, every state has a plan to every goal."""

from __future__ import annotations

import networkx as nx
import pytest

from knotflow.planning import Goal, SearchGraph, SolutionDag, UnreachableGoalError, parse_goal
from knotflow.topology import TopologicalState, Undo, knot, parse_action

TRIVIAL = TopologicalState.trivial()
OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")
STRAY = TopologicalState.parse("1o4+2o3-")  # R2(0,0,1,1), in no overhand's DAG
PATH = [parse_action(text) for text in ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)")]
GOALS = ["overhand", "trivial", "1o4+2o3-", "1o2+3o6-4o5+", "R1(0,1,1) C(0,1,1) C(2,0,1)"]


@pytest.fixture(scope="module")
def all_states() -> list[TopologicalState]:
    """The 573 states with 0 to 3 crossings."""
    levels: list[set[TopologicalState]] = [{TRIVIAL}, set(), set(), set()]
    for level in levels[:-1]:
        for state in level:
            for _, following in state.actions():
                if following.num_crossings < len(levels):
                    levels[following.num_crossings].add(following)
    return sorted(set().union(*levels))


@pytest.mark.slow
@pytest.mark.parametrize("text", GOALS)
def test_every_state_has_a_path_to_every_goal(all_states, text):
    graph = SearchGraph(parse_goal(text).dag)
    assert len(all_states) == 573
    for state in all_states:
        graph.extend(state)
    # From each a step nearer, and so on to distance 0, which only goals have.
    for state in graph.graph:
        assert (graph.distance(state) == 0) == (state in graph.goals)
        if state not in graph.goals:
            action, onward = min(graph.edges_from(state), key=lambda e: graph.distance(e[1]))
            assert state.apply(action) == onward
            assert graph.distance(onward) == graph.distance(state) - 1


def test_edges_are_all_undoings_and_the_forward_edges_of_the_dag(all_states):
    dag = Goal.named("overhand").dag
    graph = SearchGraph(dag, *all_states[::7])
    for state in graph.graph:
        forward = tuple(e for e in graph.edges_from(state) if not isinstance(e[0], Undo))
        assert forward == (dag.edges_from(state) if state in dag else ())
        undone = [edge for edge in graph.edges_from(state) if isinstance(edge[0], Undo)]
        assert len(undone) == len(set(undone)) == len(list(state.undo_actions()))
        assert set(undone) == set(state.undo_actions())


def test_distances_are_those_of_the_graph_however_it_grew(all_states):
    starts = all_states[::11]
    dag = Goal.named("figure_eight").dag
    at_once, one_by_one = SearchGraph(dag, *starts), SearchGraph(dag)
    for start in reversed(starts):
        one_by_one.extend(start)
        one_by_one.extend(start)
    backward = at_once.graph.reverse(copy=False)
    expected = nx.multi_source_dijkstra_path_length(backward, set(dag.goals), weight=None)
    assert set(at_once.graph) == set(one_by_one.graph) == set(expected)
    for state, distance in expected.items():
        assert at_once.distance(state) == one_by_one.distance(state) == distance
        assert at_once.edges_from(state) == one_by_one.edges_from(state)
        steps = [at_once.distance(onward) for _, onward in at_once.edges_from(state)]
        assert distance == (0 if state in dag.goals else 1 + min(steps))


def test_the_dag_itself_refuses_and_stays_as_it_was():
    dag = Goal.named("overhand").dag
    graph = SearchGraph(dag, STRAY)
    # The head is pulled off its strand, and the loop that is left grows to an overhand.
    assert graph.distance(STRAY) == 3
    undone = [str(action) for action, _ in graph.edges_from(STRAY)]
    assert undone == ["undo C(0,2,1)", "undo R1(1,1,-1)", "undo R2(0,0,1,1)"]
    assert STRAY not in dag and len(dag) == 13
    with pytest.raises(UnreachableGoalError, match="no sequence of them completes"):
        graph.dag.check_start(STRAY)


def test_the_untangled_rope_is_reached_by_undoing_alone():
    graph = SearchGraph(SolutionDag.to(TRIVIAL), OVERHAND)
    assert graph.distance(OVERHAND) == 3
    assert all(isinstance(action, Undo) for action, _ in graph.edges_from(OVERHAND))


def test_deep_states_are_added_on_the_fly():
    graph = SearchGraph(Goal.named("overhand").dag)
    deep = OVERHAND
    for text in ("C(0,3,1)", "C(4,0,1)", "R1(3,1,1)"):
        deep = deep.apply(parse_action(text))
    with pytest.raises(UnreachableGoalError, match="none of the 13.*extend\\(\\) adds it"):
        graph.distance(deep)
    graph.extend(deep)
    assert deep.num_crossings == 6
    assert graph.distance(deep) == 3
    assert knot("overhand") <= graph.goals


def test_one_path_from_a_tangled_start_leaves_out_what_does_not_lead_to_its_end():
    start = TRIVIAL.apply(PATH[0])
    graph = SearchGraph(SolutionDag.along(PATH[1:], start))
    assert TRIVIAL not in graph
    for state in graph.graph:
        assert all(onward in graph for _, onward in graph.edges_from(state))
    with pytest.raises(UnreachableGoalError, match="cannot be undone to any"):
        graph.extend(STRAY)
    assert STRAY not in graph and STRAY not in graph.graph


def test_a_goals_path_may_undo():
    goal = parse_goal("R1(0,1,1) C(0,1,1), undo C(0,1,1)")
    assert goal.states == {TRIVIAL.apply(PATH[0])}
    assert goal.dag.distance(TRIVIAL) == 1

"""Solution DAGs, and search graphs, in which every state has a path to every goal."""

from __future__ import annotations

import pytest

from knotflow.planning import SolutionDag, UnreachableGoalError, parse_goal
from knotflow.topology import IllegalActionError, TopologicalState, Undo, knot, parse_action

TRIVIAL = TopologicalState.trivial()
OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")
STRAY = TopologicalState.parse("1o4+2o3-")  # R2(0,0,1,1), in no overhand's DAG
GOALS = ["overhand", "trivial", "1o4+2o3-", "1o2+3o6-4o5+", "R1(0,1,1) C(0,1,1) C(2,0,1)"]
PATH = [parse_action(text) for text in ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)")]


@pytest.mark.parametrize("name", ["overhand", "figure_eight", "pentagram"])
def test_distance_is_one_more_than_at_nearest_neighbour(name):
    dag = parse_goal(name).dag
    assert dag.goals == knot(name)
    for state in dag.graph:
        nearest = [dag.distance(onward) for _, onward in dag.edges_from(state)]
        if state in dag.goals:
            assert dag.distance(state) == 0
        else:
            assert dag.distance(state) == min(nearest) + 1
        for action, onward in dag.edges_from(state):
            assert state.apply(action) == onward


def test_shortest_path_leads_to_a_goal_in_as_many_edges_as_the_distance():
    dag = parse_goal("overhand").dag
    for start in dag.graph:
        state, path = start, dag.shortest_path(start)
        for action in path:
            state = state.apply(action)
        assert state in dag.goals and len(path) == dag.distance(start)


def test_path_has_one_edge_per_state():
    dag = SolutionDag.along(PATH)
    assert len(dag) == 4
    assert dag.distance(TRIVIAL) == 3
    assert [str(goal) for goal in dag.goals] == ["4o1+2o5+6o3+"]


def test_a_path_may_begin_tangled():
    start = TRIVIAL.apply(PATH[0])
    dag = SolutionDag.along(PATH[1:], start)
    assert dag.distance(start) == 2
    assert TRIVIAL not in dag


def test_illegal_path_is_refused():
    with pytest.raises(IllegalActionError, match="no segment 2"):
        SolutionDag.along([PATH[2]])
    with pytest.raises(ValueError, match="at least one action"):
        SolutionDag.along([])


def test_after_keeps_what_leads_to_the_goal():
    dag = parse_goal("pentagram").dag
    overhand = TopologicalState.parse("4o1+2o5+6o3+")
    part = dag.after(overhand)
    assert overhand in part and TRIVIAL not in part
    assert part.distance(overhand) == dag.distance(overhand) == 2
    assert part.goals < dag.goals


def test_unreachable_goal_is_explained():
    dag = parse_goal("overhand").dag
    stray = TRIVIAL.apply(parse_action("R2(0,0,1,1)"))
    for call in (dag.distance, dag.check_start, dag.after):
        with pytest.raises(UnreachableGoalError, match="no known actions lead"):
            call(stray)
    deep = TopologicalState.parse("6o1+2o7+8o3+4o9+10o5+")
    with pytest.raises(UnreachableGoalError, match="choose a goal that contains them"):
        dag.check_start(deep)


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
    assert len(all_states) == 573
    graph = parse_goal(text).dag.with_undoings(*all_states)
    # From each a step nearer, and so on to distance 0, which only goals have.
    for state in graph.graph:
        assert (graph.distance(state) == 0) == (state in graph.goals)
        if state not in graph.goals:
            action, onward = min(graph.edges_from(state), key=lambda e: graph.distance(e[1]))
            assert state.apply(action) == onward
            assert graph.distance(onward) == graph.distance(state) - 1


def test_edges_are_undoings_and_forward_edges(all_states):
    dag = parse_goal("overhand").dag
    graph = dag.with_undoings(*all_states[::7])
    for state in graph.graph:
        forward = tuple(e for e in graph.edges_from(state) if not isinstance(e[0], Undo))
        assert forward == (dag.edges_from(state) if state in dag else ())
        undone = [edge for edge in graph.edges_from(state) if isinstance(edge[0], Undo)]
        assert len(undone) == len(set(undone)) == len(list(state.undo_actions()))
        assert set(undone) == set(state.undo_actions())


def test_distances_do_not_depend_on_further_starts(all_states):
    starts = all_states[::11]
    dag = parse_goal("figure_eight").dag
    of_all = dag.with_undoings(*starts)
    for start in starts[::5]:
        own = dag.with_undoings(start)
        for state in own.graph:
            assert of_all.distance(state) == own.distance(state)
            assert of_all.edges_from(state) == own.edges_from(state)
            steps = [own.distance(onward) for _, onward in own.edges_from(state)]
            assert own.distance(state) == (0 if state in dag.goals else 1 + min(steps))


def test_undoings_leave_the_dag_unchanged():
    dag = parse_goal("overhand").dag
    graph = dag.with_undoings(STRAY)
    # The head is pulled off its strand, and the loop that is left grows to an overhand.
    assert graph.distance(STRAY) == 3
    undone = [str(action) for action, _ in graph.edges_from(STRAY)]
    assert undone == ["undo C(0,2,1)", "undo R1(1,1,-1)", "undo R2(0,0,1,1)"]
    assert STRAY not in dag and len(dag) == 13
    with pytest.raises(UnreachableGoalError, match="no known actions lead"):
        dag.check_start(STRAY)


def test_trivial_goal_is_reached_by_undoing():
    graph = SolutionDag.to(TRIVIAL).with_undoings(OVERHAND)
    assert graph.distance(OVERHAND) == 3
    assert all(isinstance(action, Undo) for action, _ in graph.edges_from(OVERHAND))


def test_states_with_many_crossings_are_added():
    dag, deep = parse_goal("overhand").dag, OVERHAND
    for text in ("C(0,3,1)", "C(4,0,1)", "R1(3,1,1)"):
        deep = deep.apply(parse_action(text))
    with pytest.raises(UnreachableGoalError, match="no known actions lead"):
        dag.with_undoings().distance(deep)
    graph = dag.with_undoings(deep)
    assert deep.num_crossings == 6
    assert graph.distance(deep) == 3
    assert knot("overhand") <= graph.goals


def test_path_from_tangled_start_keeps_what_leads_to_its_end():
    start = TRIVIAL.apply(PATH[0])
    dag = SolutionDag.along(PATH[1:], start)
    graph = dag.with_undoings()
    assert TRIVIAL not in graph
    for state in graph.graph:
        assert all(onward in graph for _, onward in graph.edges_from(state))
    with pytest.raises(UnreachableGoalError, match="no known actions lead"):
        dag.with_undoings(STRAY)


def test_path_may_undo():
    goal = parse_goal("R1(0,1,1) C(0,1,1), undo C(0,1,1)")
    assert goal.states == {TRIVIAL.apply(PATH[0])}
    assert goal.dag.distance(TRIVIAL) == 1

import pytest

from knotflow.planning import Goal, SolutionDag, UnreachableGoalError
from knotflow.topology import IllegalActionError, TopologicalState, knot, parse_action

TRIVIAL = TopologicalState.trivial()
PATH = [parse_action(text) for text in ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)")]


@pytest.mark.parametrize("name", ["overhand", "figure_eight", "pentagram"])
def test_each_edge_brings_a_state_at_most_one_edge_nearer(name):
    dag = Goal.named(name).dag
    assert dag.goals == knot(name)
    for state in dag.graph:
        nearest = [dag.distance(onward) for _, onward in dag.edges_from(state)]
        if state in dag.goals:
            assert dag.distance(state) == 0
        else:
            assert dag.distance(state) == min(nearest) + 1
        for action, onward in dag.edges_from(state):
            assert state.apply(action) == onward


def test_a_path_has_one_edge_a_state():
    dag = SolutionDag.along(PATH)
    assert len(dag) == 4
    assert dag.distance(TRIVIAL) == 3
    assert [str(goal) for goal in dag.goals] == ["4o1+2o5+6o3+"]


def test_a_path_may_begin_tangled():
    start = TRIVIAL.apply(PATH[0])
    dag = SolutionDag.along(PATH[1:], start)
    assert dag.distance(start) == 2
    assert TRIVIAL not in dag


def test_an_illegal_path_says_which_rule_it_breaks():
    with pytest.raises(IllegalActionError, match="no segment 2"):
        SolutionDag.along([PATH[2]])
    with pytest.raises(ValueError, match="at least one action"):
        SolutionDag.along([])


def test_the_part_after_a_state_reaches_the_goal_and_nothing_else():
    dag = Goal.named("pentagram").dag
    overhand = TopologicalState.parse("4o1+2o5+6o3+")
    part = dag.after(overhand)
    assert overhand in part and TRIVIAL not in part
    assert part.distance(overhand) == dag.distance(overhand) == 2
    assert part.goals < dag.goals


def test_states_from_which_the_goal_is_out_of_reach_are_refused_with_the_reason():
    dag = Goal.named("overhand").dag
    stray = TRIVIAL.apply(parse_action("R2(0,0,1,1)"))
    for call in (dag.distance, dag.check_start, dag.after):
        with pytest.raises(UnreachableGoalError, match="no sequence of them completes"):
            call(stray)
    deep = TopologicalState.parse("6o1+2o7+8o3+4o9+10o5+")
    with pytest.raises(UnreachableGoalError, match="5 crossings already and the goal has 3"):
        dag.check_start(deep)

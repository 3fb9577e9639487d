import pytest

from knotflow.planning import Goal, parse_goal
from knotflow.simulation import RopeConfig
from knotflow.topology import (
    KNOT_NAMES,
    IllegalActionError,
    InvalidStateError,
    TopologicalState,
    knot,
)

OVERHAND = "4o1+2o5+6o3+"


@pytest.mark.parametrize("name", KNOT_NAMES)
def test_a_name_stands_for_all_states_of_the_knot(name):
    goal = parse_goal(f" {name} ", RopeConfig())
    assert (goal.name, goal.states) == (name, knot(name))


def test_crossings_stand_for_one_state():
    goal = parse_goal(OVERHAND)
    assert goal.states == {TopologicalState.parse(OVERHAND)}
    assert goal.name == OVERHAND


@pytest.mark.parametrize("separator", ["", " ", ",", ", ", "; "])
def test_actions_stand_for_one_path(separator):
    goal = parse_goal(separator.join(["R1(0,1,1)", "C(0,1,1)", "C(2,0,1)"]))
    assert goal.states == {TopologicalState.parse(OVERHAND)}
    assert len(goal.dag) == 4


def test_a_goal_keeps_the_name_it_was_asked_by():
    again = parse_goal(Goal.state(TopologicalState.parse(OVERHAND)).name)
    assert again.states == {TopologicalState.parse(OVERHAND)}


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("sheepshank", ValueError, "overhand, figure_eight"),
        ("", ValueError, "unknown knot"),
        ("(4,1,1)", ValueError, "crossings .'4o1"),
        ("1o3+2o4+", InvalidStateError, "no plane curve"),
        ("C(2,0,1)", IllegalActionError, "no segment 2"),
        ("X(2,0,1)", IllegalActionError, "not an action"),
    ],
)
def test_what_is_no_goal_is_refused_with_what_would_be(text, error, message):
    with pytest.raises(error, match=message):
        parse_goal(text)


def loops(count):
    """A state of `count` loops one after the other."""
    return "".join(f"{2 * k + 2}o{2 * k + 1}+" for k in range(count))


@pytest.mark.parametrize(
    ("length", "radius", "room"), [(1.0, 0.004, 24), (1.0, 0.008, 15), (0.5, 0.008, 7)]
)
def test_a_goal_has_to_fit_the_rope(length, radius, room):
    rope = RopeConfig(length=length, radius=radius, links=round(50 * length))
    with pytest.raises(ValueError, match=f"room for about {room}.*longer or thinner"):
        parse_goal(loops(room + 1), rope)


def test_a_path_has_to_fit_too():
    short = RopeConfig(length=0.1, links=20)
    for goal in ("R1(0,1,1) C(0,1,1) C(2,0,1)", "overhand"):
        with pytest.raises(ValueError, match="longer or thinner"):
            parse_goal(goal, short)

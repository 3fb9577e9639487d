import pytest

from knotflow.planning import Goal, most_crossings, parse_goal
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


@pytest.mark.parametrize(
    "text", [OVERHAND, "[(4,1,1),(2,5,1),(6,3,1)]", "[[6, 3, 1], [4, 1, 1], [2, 5, 1]]"]
)
def test_crossings_stand_for_one_state(text):
    goal = parse_goal(text)
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
        ("bowline", ValueError, "overhand, figure_eight"),
        ("", ValueError, "unknown knot"),
        ("[(4,1,1),(2,5", ValueError, "cannot be read"),
        ("(4,1,1)", InvalidStateError, "not a list of crossings"),
        ("[(1,2,1),(2,3,1)]", InvalidStateError, "used twice"),
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


def test_a_goal_has_to_fit_the_rope():
    rope = RopeConfig()
    room = most_crossings(rope)
    assert max(state.num_crossings for state in knot("three_twist")) <= room
    with pytest.raises(ValueError, match=f"room for about {room}"):
        parse_goal(loops(room + 1), rope)


def test_a_path_has_to_fit_too():
    short = RopeConfig(length=0.1, links=20)
    with pytest.raises(ValueError, match="longer or thinner"):
        parse_goal("R1(0,1,1) C(0,1,1) C(2,0,1)", short)
    with pytest.raises(ValueError, match="room for about"):
        parse_goal("overhand", short)


def test_room_grows_with_length_and_shrinks_with_radius():
    def room(length, radius):
        return most_crossings(RopeConfig(length=length, radius=radius, links=200))

    assert room(0.5, 0.008) < room(1.0, 0.008) < room(1.0, 0.004)
    assert room(0.02, 0.02) == 0

"""R1, R2 and Cross: their text, their conventions, and where they are legal."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.topology import (
    R1,
    R2,
    Cross,
    IllegalActionError,
    TopologicalState,
    knot,
    parse_action,
)

# The eight actions of Fig. 6 with the actions that lead to their start states.
EIGHT = {
    "R1(0,1,1)": [],
    "R2(0,0,1,1)": [],
    "C(0,1,1)": ["R1(0,1,1)"],
    "C(0,2,1)": ["R1(0,1,1)"],
    "C(4,2,1)": ["R1(0,1,1)", "C(1,2,1)"],
    "C(1,2,1)": ["R1(0,1,1)"],
    "C(2,0,1)": ["R1(0,1,1)", "C(0,1,1)"],
    "C(2,4,1)": ["R1(0,1,1)", "C(0,1,1)"],
}


def after(*actions):
    state = TopologicalState.trivial()
    for action in actions:
        state = state.apply(parse_action(action))
    return state


def all_actions(num_segments):
    """Every action whose segments exist, legal or not, in canonical form."""
    signs, segments = (1, -1), range(num_segments)
    for over in segments:
        yield from (R1(over, left, sign) for left in signs for sign in signs)
        for under in segments:
            yield from (Cross(over, under, sign) for sign in signs)
            firsts = signs if over == under else (1 if over < under else -1,)
            yield from (R2(over, under, left, first) for left in signs for first in firsts)


@pytest.mark.parametrize("text", EIGHT)
def test_eight_actions_are_legal_from_their_start_states(text):
    action = parse_action(text)
    assert str(action) == text
    assert action in dict(after(*EIGHT[text]).actions())


def test_actions_lists_what_apply_allows(states_by_crossings):
    for states in states_by_crossings[:3]:
        for state in states:
            listed = list(state.actions())
            assert len({action for action, _ in listed}) == len(listed)
            allowed = {}
            for action in all_actions(state.num_segments):
                try:
                    allowed[action] = state.apply(action)
                except IllegalActionError:
                    continue
            assert dict(listed) == allowed


def test_action_text_parses_back(states_by_crossings):
    for state in states_by_crossings[1]:
        for action, _ in state.actions():
            assert parse_action(str(action)) == action


def test_conventions():
    assert after("R1(0,1,1)").crossings == ((2, 1, 1),)
    assert after("R2(0,0,1,1)").crossings == ((1, 4, 1), (2, 3, -1))
    assert after("R1(0,1,1)", "C(0,1,1)").crossings == ((1, 3, 1), (4, 2, 1))
    overhand = ((4, 1, 1), (2, 5, 1), (6, 3, 1))
    assert after("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)").crossings == overhand
    assert after("R1(0,1,1)", "C(1,2,1)", "C(4,2,1)").crossings == overhand


def test_r1_makes_four_loops():
    trivial = TopologicalState.trivial()
    loops = {trivial.apply(R1(0, left, sign)) for left in (1, -1) for sign in (1, -1)}
    assert len(loops) == 4
    assert {loop.num_crossings for loop in loops} == {1}
    for left in (1, -1):
        planar_map = trivial.apply(R1(0, left, 1)).planar_map
        assert planar_map.segments_around(planar_map.face(1, left)) == (1,)


def test_r2_makes_opposite_signs_and_a_bigon(states_by_crossings):
    def bigons(state):
        return [face for face in state.planar_map.faces if len(face) == 2]

    for state in states_by_crossings[1]:
        assert not bigons(state)
        for action, following in state.actions():
            if isinstance(action, R2):
                assert sum(s for *_, s in following.crossings) == sum(
                    s for *_, s in state.crossings
                )
                assert bigons(following)


def test_r2_ignores_over_first_for_two_segments():
    loop = after("R1(0,1,1)")
    assert loop.apply(R2(0, 2, 1, 1)) == loop.apply(R2(0, 2, 1, -1))
    canonical = [action for action, _ in loop.actions() if isinstance(action, R2)]
    assert all(
        action.over_first == (1 if action.over < action.under else -1)
        for action in canonical
        if action.over != action.under
    )


def test_both_signs_are_legal_across_a_bridge():
    loop = after("R1(0,1,1)")
    for over, under in ((0, 2), (2, 0)):
        for sign in (1, -1):
            assert loop.apply(Cross(over, under, sign)).num_crossings == 2
    assert [a for a, _ in loop.actions() if isinstance(a, Cross) and a.segments == (0, 1)] == [
        Cross(0, 1, 1)
    ]


@pytest.mark.parametrize(
    ("start", "action", "rule"),
    [
        ([], "C(0,0,1)", "crosses itself makes a loop"),
        ([], "R1(1,1,1)", "no segment 1; this state has segments 0 to 0"),
        (["R1(0,1,1)"], "R2(0,3,1,1)", "no segment 3"),
        (["R1(0,1,1)"], "C(0,1,-1)", "which makes the sign \\+1"),
        (["R1(0,1,1)", "C(0,1,1)"], "C(1,2,1)", "head segment 0 or the tail segment 4"),
        (["R1(0,1,1)", "R1(1,1,1)"], "C(0,2,1)", "must border a common face"),
        (["R1(0,1,1)"], "R2(1,0,1,1)", "must border a common face.*left=-1"),
    ],
)
def test_illegal_action_names_the_broken_rule(start, action, rule):
    with pytest.raises(IllegalActionError, match=rule):
        after(*start).apply(parse_action(action))


def test_end_inside_a_face_crosses_only_its_border():
    pentagram = sorted(knot("pentagram"))[0]
    planar_map = pentagram.planar_map
    reach = set(planar_map.segments_around(planar_map.left[0]))
    crossed = {
        action.under
        for action, _ in pentagram.actions()
        if isinstance(action, Cross) and action.over == 0
    }
    assert crossed == reach - {0}


@pytest.mark.parametrize(
    "text", ["", "C", "R3(0,1)", "C(0,1)", "C(0,1,1,1)", "C(0,one,1)", "c(0,1,1)", "R1(0,1,1"]
)
def test_invalid_text_lists_valid_forms(text):
    with pytest.raises(IllegalActionError, match="R1\\(index,left,sign\\)"):
        parse_action(text)


@pytest.mark.parametrize(
    ("make", "wrong"),
    [
        (lambda: R1(-1, 1, 1), "index must be 0 or more"),
        (lambda: R1(0, 0, 1), "left must be \\+1 or -1"),
        (lambda: R2(0, 0, 1, 2), "over_first must be \\+1 or -1"),
        (lambda: Cross(0, 1, 0.5), "sign must be a whole number"),
    ],
)
def test_invalid_parameters_are_rejected(make, wrong):
    with pytest.raises(IllegalActionError, match=wrong):
        make()


def test_numpy_integers_become_int():
    assert str(Cross(np.int64(2), np.int64(0), np.int64(1))) == "C(2,0,1)"


def test_over_and_under_segments():
    assert (Cross(2, 0, 1).over_segment, Cross(2, 0, 1).under_segment) == (2, 0)
    assert (R1(3, 1, 1).over_segment, R1(3, 1, 1).under_segment) == (3, 3)

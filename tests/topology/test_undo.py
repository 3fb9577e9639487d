"""Undoing: the inverse of every action is an action, with the laws of the others."""

from __future__ import annotations

import pytest

from knotflow.topology import (
    R1,
    R2,
    Cross,
    IllegalActionError,
    TopologicalState,
    Undo,
    knot,
    parse_action,
)
from knotflow.topology.symmetry import Symmetry

OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")


def test_undoings_are_exactly_the_inverses_of_the_actions_that_lead_here(states_by_crossings):
    leading = {state: set() for states in states_by_crossings for state in states}
    for states in states_by_crossings[:3]:
        for state in states:
            for action, following in state.actions():
                if following in leading:
                    leading[following].add((Undo(action), state))
    for state, expected in leading.items():
        found = list(state.undoings())
        assert len(found) == len(set(found))
        assert set(found) == expected
        assert found or state == TopologicalState.trivial()


def test_undoing_and_doing_are_inverse(states_by_crossings):
    for states in states_by_crossings[1:]:
        for state in states:
            for undoing, previous in state.undoings():
                assert state.apply(undoing) == state.undo(undoing.action) == previous
                assert previous.apply(undoing.action) == state
                assert previous.undo(undoing) == state


def test_the_actions_of_a_state_hold_no_undoing(states_by_crossings):
    for state in states_by_crossings[2]:
        assert not any(isinstance(action, Undo) for action, _ in state.actions())


@pytest.mark.slow
@pytest.mark.parametrize("symmetry", Symmetry.all(), ids=str)
def test_symmetries_commute_with_undoing(states_by_crossings, symmetry):
    for states in states_by_crossings[1:]:
        for state in states:
            count, moved_state = state.num_segments, symmetry.of_state(state)
            moved = {
                (symmetry.of_action(undoing, count), symmetry.of_state(previous))
                for undoing, previous in state.undoings()
            }
            assert moved == set(moved_state.undoings())
            for undoing, _ in state.undoings():
                image = symmetry.of_action(undoing, count)
                assert symmetry.of_action(image, count) == undoing
                places = [undoing.pulled_segment(count), *undoing.segments]
                if symmetry.reverse:
                    places = [count - 1 - segment for segment in places]
                assert [image.pulled_segment(count), *image.segments] == places


def test_the_segments_are_those_of_the_crossings_taken_back(states_by_crossings):
    for states in states_by_crossings[1:]:
        for state in states:
            for undoing, previous in state.undoings():
                taken = [c for c in state.crossings if c[0] in undoing.action.new_positions]
                # A segment lies between the passages of its own number and of the next.
                over, under = undoing.over_segment, undoing.under_segment
                assert {over, over + 1} & {crossing[0] for crossing in taken}
                assert {under, under + 1} & {crossing[1] for crossing in taken}
                ends = (0, state.num_segments - 1)
                pulled = undoing.pulled_segment(state.num_segments)
                assert (pulled in ends) == isinstance(undoing.action, Cross)
                pair = {pulled, undoing.other_segment(state.num_segments)}
                assert pair == {over, under}
                left = undoing.num_segments_after(state.num_segments)
                assert left == previous.num_segments


@pytest.mark.parametrize(
    ("state", "text", "segments", "pulled"),
    [
        ("2o1+", "undo R1(0,1,1)", (1,), 1),
        ("1o4+2o3-", "undo R2(0,0,1,1)", (1, 3), 1),
        ("4o1+2o5+6o3+", "undo C(2,0,1)", (4, 0), 0),
        ("4o1+2o5+6o3+", "undo C(4,2,1)", (6, 2), 6),
    ],
)
def test_conventions(state, text, segments, pulled):
    state, undoing = TopologicalState.parse(state), parse_action(text)
    assert undoing in dict(state.undoings())
    assert undoing.segments == segments
    assert undoing.pulled_segment(state.num_segments) == pulled


def test_text_parses_back(states_by_crossings):
    assert str(Undo(Cross(2, 0, 1))) == "undo C(2,0,1)"
    for state in states_by_crossings[3]:
        for undoing, _ in state.undoings():
            assert parse_action(str(undoing)) == undoing
    assert parse_action("  undo   R1( 0, 1, 1 ) ") == Undo(R1(0, 1, 1))


@pytest.mark.parametrize("text", ["undo", "undoC(2,0,1)", "undo undo C(2,0,1)", "redo C(2,0,1)"])
def test_text_that_is_no_undoing_lists_the_valid_forms(text):
    with pytest.raises(IllegalActionError, match="C\\(over,under,sign\\), and each of them after"):
        parse_action(text)


def test_what_adds_no_crossings_cannot_be_undone():
    for wrong in (Undo(Cross(2, 0, 1)), "C(2,0,1)"):
        with pytest.raises(IllegalActionError, match="R1, R2 and Cross can be undone"):
            Undo(wrong)


def test_an_undoing_that_the_state_does_not_allow_names_those_it_does():
    with pytest.raises(IllegalActionError, match="does not lead to.*do: .*C\\(2,0,1\\)"):
        OVERHAND.apply(Undo(Cross(0, 1, 1)))
    with pytest.raises(IllegalActionError, match="does not lead to.*do: none"):
        TopologicalState.trivial().apply(Undo(R1(0, 1, 1)))


def test_a_rope_without_such_segments_is_refused():
    for undoing, count in ((Undo(Cross(2, 0, 1)), 3), (Undo(R2(0, 0, 1, 1)), 1)):
        for call in (undoing.reversed, undoing.check_segments):
            with pytest.raises(IllegalActionError, match=f"of the {count} segments"):
                call(count)


def test_a_knot_is_undone_to_the_straight_rope():
    for state in knot("pentagram"):
        while state.num_crossings:
            _, previous = next(state.undoings())
            assert previous.num_crossings < state.num_crossings
            state = previous

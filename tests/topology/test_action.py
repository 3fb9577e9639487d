"""Undo, the inverse of every action that adds crossings, and Arrange."""

from __future__ import annotations

import pytest

from knotflow.topology import (
    R1,
    R2,
    Arrange,
    Cross,
    IllegalActionError,
    TopologicalState,
    Undo,
    knot,
    parse_action,
)
from knotflow.topology.symmetry import Symmetry

OVERHAND = TopologicalState.parse("4o1+2o5+6o3+")


def test_undo_actions_are_inverses_of_leading_actions(states_by_crossings):
    leading = {state: set() for states in states_by_crossings for state in states}
    for states in states_by_crossings[:3]:
        for state in states:
            for action, following in state.actions():
                if following in leading:
                    leading[following].add((Undo(action), state))
    for state, expected in leading.items():
        found = list(state.undo_actions())
        assert len(found) == len(set(found))
        assert set(found) == expected
        assert found or state == TopologicalState.trivial()


def test_undo_and_apply_are_inverse(states_by_crossings):
    for states in states_by_crossings[1:]:
        for state in states:
            for undo, previous in state.undo_actions():
                assert state.apply(undo) == state.undo(undo.action) == previous
                assert previous.apply(undo.action) == state


def test_actions_do_not_list_undo(states_by_crossings):
    for state in states_by_crossings[2]:
        assert not any(isinstance(action, Undo) for action, _ in state.actions())


@pytest.mark.slow
@pytest.mark.parametrize("symmetry", Symmetry.all(), ids=str)
def test_symmetries_commute_with_undo(states_by_crossings, symmetry):
    for states in states_by_crossings[1:]:
        for state in states:
            count, moved_state = state.num_segments, symmetry.of_state(state)
            moved = {
                (symmetry.of_action(undo, count), symmetry.of_state(previous))
                for undo, previous in state.undo_actions()
            }
            assert moved == set(moved_state.undo_actions())
            for undo, _ in state.undo_actions():
                image = symmetry.of_action(undo, count)
                assert symmetry.of_action(image, count) == undo
                places = [undo.pulled_segment(count), *undo.segments]
                if symmetry.reverse:
                    places = [count - 1 - segment for segment in places]
                assert [image.pulled_segment(count), *image.segments] == places


def test_undo_segments_border_removed_crossings(states_by_crossings):
    for states in states_by_crossings[1:]:
        for state in states:
            for undo, previous in state.undo_actions():
                taken = [c for c in state.crossings if c[0] in undo.action.new_positions]
                # A segment lies between the passages of its own number and of the next.
                over, under = undo.over_segment, undo.under_segment
                assert {over, over + 1} & {crossing[0] for crossing in taken}
                assert {under, under + 1} & {crossing[1] for crossing in taken}
                ends = (0, state.num_segments - 1)
                pulled = undo.pulled_segment(state.num_segments)
                assert (pulled in ends) == isinstance(undo.action, Cross)
                pair = {pulled, undo.other_segment(state.num_segments)}
                assert pair == {over, under}
                assert pulled == over or {over, under} & {*ends} == {under}
                left = undo.num_segments_after(state.num_segments)
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
def test_undo_conventions(state, text, segments, pulled):
    state, undo = TopologicalState.parse(state), parse_action(text)
    assert undo in dict(state.undo_actions())
    assert undo.segments == segments
    assert undo.pulled_segment(state.num_segments) == pulled


def test_undo_text_parses_back(states_by_crossings):
    assert str(Undo(Cross(2, 0, 1))) == "undo C(2,0,1)"
    for state in states_by_crossings[3]:
        for undo, _ in state.undo_actions():
            assert parse_action(str(undo)) == undo
    assert parse_action("  undo   R1( 0, 1, 1 ) ") == Undo(R1(0, 1, 1))


@pytest.mark.parametrize("text", ["undo", "undoC(2,0,1)", "undo undo C(2,0,1)", "redo C(2,0,1)"])
def test_invalid_undo_text_lists_valid_forms(text):
    with pytest.raises(IllegalActionError, match="C\\(over,under,sign\\), and each of them after"):
        parse_action(text)


def test_illegal_undo_lists_legal_ones():
    with pytest.raises(IllegalActionError, match="does not lead to.*do: .*C\\(2,0,1\\)"):
        OVERHAND.apply(Undo(Cross(0, 1, 1)))
    with pytest.raises(IllegalActionError, match="does not lead to.*do: none"):
        TopologicalState.trivial().apply(Undo(R1(0, 1, 1)))


def test_undo_of_missing_segments_is_rejected():
    for undo, count in ((Undo(Cross(2, 0, 1)), 3), (Undo(R2(0, 0, 1, 1)), 1)):
        for call in (undo.reversed, undo.check_segments):
            with pytest.raises(IllegalActionError, match=f"of the {count} segments"):
                call(count)


def test_knot_is_undone_to_trivial():
    for state in knot("pentagram"):
        while state.num_crossings:
            _, previous = next(state.undo_actions())
            assert previous.num_crossings < state.num_crossings
            state = previous


STATE = TopologicalState.parse("1o3+4o2+")
WANTED = [*STATE.actions(), *STATE.undo_actions()]


@pytest.mark.parametrize("wanted", [action for action, _ in WANTED], ids=str)
def test_arrange_keeps_state_and_parses_back(wanted):
    arrange = Arrange(wanted)
    assert STATE.apply(arrange) == STATE
    assert str(arrange) == f"arrange for {wanted}"
    assert parse_action(str(arrange)) == arrange
    assert arrange.segments == wanted.segments
    assert arrange.mirrored().mirrored() == arrange
    assert STATE.reversed().apply(arrange.reversed(STATE.num_segments)) == STATE.reversed()


def test_arranging_for_an_illegal_action_is_rejected():
    with pytest.raises(IllegalActionError, match="no segment 7"):
        STATE.apply(Arrange(Cross(7, 0, 1)))
    with pytest.raises(IllegalActionError):
        TopologicalState.trivial().apply(Arrange(Undo(Cross(2, 0, 1))))


def test_arrange_is_not_listed_and_does_not_nest():
    assert not any(isinstance(action, Arrange) for action, _ in WANTED)
    with pytest.raises(IllegalActionError, match="must change the state"):
        Arrange(Arrange(Cross(2, 0, 1)))

"""Arranging is an action that keeps the state."""

from __future__ import annotations

import pytest

from knotflow.topology import (
    Arrange,
    Cross,
    IllegalActionError,
    TopologicalState,
    Undo,
    parse_action,
)

STATE = TopologicalState.parse("1o3+4o2+")
WANTED = [*STATE.actions(), *STATE.undoings()]


@pytest.mark.parametrize("wanted", [action for action, _ in WANTED], ids=str)
def test_it_keeps_the_state_and_reads_back(wanted):
    arrange = Arrange(wanted)
    assert STATE.apply(arrange) == STATE
    assert str(arrange) == f"arrange for {wanted}"
    assert parse_action(str(arrange)) == arrange
    assert arrange.segments == wanted.segments
    assert arrange.mirrored().mirrored() == arrange
    assert STATE.reversed().apply(arrange.reversed(STATE.num_segments)) == STATE.reversed()


def test_what_is_not_legal_cannot_be_wanted():
    with pytest.raises(IllegalActionError, match="no segment 7"):
        STATE.apply(Arrange(Cross(7, 0, 1)))
    with pytest.raises(IllegalActionError):
        TopologicalState.trivial().apply(Arrange(Undo(Cross(2, 0, 1))))


def test_no_list_of_actions_has_it_and_it_does_not_nest():
    assert not any(isinstance(action, Arrange) for action, _ in WANTED)
    with pytest.raises(IllegalActionError, match="changes the state"):
        Arrange(Arrange(Cross(2, 0, 1)))

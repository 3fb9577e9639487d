"""Descriptions of actions."""

import pytest

from knotflow.topology import Arrange, IllegalActionError, TopologicalState, parse_action
from knotflow.topology.action_text import describe

STATES = [TopologicalState.parse(text) for text in ("trivial", "2o1+", "3o1-2o4-")]


@pytest.mark.parametrize("state", STATES, ids=str)
def test_description_names_both_states(state):
    for action, after in state.actions():
        sentence = describe(action, state)
        assert sentence.startswith(f"{action}: ")
        assert sentence.endswith(f"; {state} becomes {after}.")


@pytest.mark.parametrize("state", STATES, ids=str)
def test_undo_and_arrange_are_described(state):
    for undo, before in state.undo_actions():
        sentence = describe(undo, state)
        assert "removes" in sentence and sentence.endswith(f"; {state} becomes {before}.")
    for action, _ in state.actions():
        sentence = describe(Arrange(action), state)
        assert describe(action, state).partition(";")[0].partition(": ")[2] in sentence
        assert sentence.endswith(f"; {state} stays.")


@pytest.mark.parametrize("state", STATES, ids=str)
def test_mirror_exchanges_left_and_right(state):
    for action, _ in state.actions():
        seen = describe(action.mirrored(), state.mirrored()).partition(";")[0]
        swapped = seen.replace("left", "?").replace("right", "left").replace("?", "right")
        swapped = swapped.replace("sign -", "?").replace("sign +", "sign -").replace("?", "sign +")
        assert (
            swapped.partition(": ")[2]
            == describe(action, state).partition(";")[0].partition(": ")[2]
        )


def test_illegal_action_is_rejected():
    with pytest.raises(IllegalActionError, match="there is no segment 9"):
        describe(parse_action("C(0,9,1)"), STATES[0])

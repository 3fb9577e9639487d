"""Actions in words: every legal one has its sentence, and the sentence says what the faces say."""

import pytest

from knotflow.topology import Arrange, IllegalActionError, TopologicalState, parse_action
from knotflow.topology.words import describe

STATES = [TopologicalState.parse(text) for text in ("trivial", "2o1+", "3o1-2o4-")]


@pytest.mark.parametrize("state", STATES, ids=str)
def test_every_action_has_a_sentence_that_names_both_states(state):
    for action, after in state.actions():
        sentence = describe(action, state)
        assert sentence.startswith(f"{action}: ")
        assert sentence.endswith(f"; {state} becomes {after}.")


@pytest.mark.parametrize("state", STATES, ids=str)
def test_undoing_and_arranging_have_sentences(state):
    for undo, before in state.undoings():
        assert describe(undo, state).endswith(f" back; {state} becomes {before}.")
    for action, _ in state.actions():
        sentence = describe(Arrange(action), state)
        assert describe(action, state).partition(";")[0].partition(": ")[2] in sentence
        assert sentence.endswith(f"; {state} stays.")


@pytest.mark.parametrize("state", STATES, ids=str)
def test_a_mirror_exchanges_left_and_right(state):
    for action, _ in state.actions():
        seen = describe(action.mirrored(), state.mirrored()).partition(";")[0]
        swapped = seen.replace("left", "?").replace("right", "left").replace("?", "right")
        swapped = swapped.replace("sign -", "?").replace("sign +", "sign -").replace("?", "sign +")
        assert (
            swapped.partition(": ")[2]
            == describe(action, state).partition(";")[0].partition(": ")[2]
        )


def test_an_illegal_action_has_none():
    with pytest.raises(IllegalActionError, match="there is no segment 9"):
        describe(parse_action("C(0,9,1)"), STATES[0])

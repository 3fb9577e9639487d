"""States: which there are, what is refused, and that undo undoes."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knotflow.topology import R1, Cross, IllegalActionError, InvalidStateError, TopologicalState
from knotflow.topology.planar_map import trace_faces


def pairings(positions):
    if not positions:
        yield ()
        return
    first = positions[0]
    for place in range(1, len(positions)):
        rest = positions[1:place] + positions[place + 1 :]
        for pairing in pairings(rest):
            yield ((first, positions[place]), *pairing)


def signed_codes(count):
    """Every signed Gauss code of `count` crossings, drawable or not."""
    for pairing in pairings(list(range(1, 2 * count + 1))):
        for flips in itertools.product((False, True), repeat=count):
            for signs in itertools.product((1, -1), repeat=count):
                yield tuple(
                    (second, first, sign) if flip else (first, second, sign)
                    for (first, second), flip, sign in zip(pairing, flips, signs, strict=True)
                )


def euler_number(code):
    return (len(code) + 2) - (2 * len(code) + 1) + len(trace_faces(code).faces)


def test_actions_reach_all_drawable_codes(states_by_crossings):
    assert [len(states) for states in states_by_crossings] == [1, 4, 40, 528]
    for count, states in enumerate(states_by_crossings):
        drawable = {code for code in signed_codes(count) if euler_number(code) == 2}
        assert {state.crossings for state in states} == drawable


@pytest.mark.slow
def test_there_are_7968_states_with_four_crossings(states_by_crossings):
    reached = {
        following
        for states in states_by_crossings[2:]
        for state in states
        for _, following in state.actions()
        if following.num_crossings == 4
    }
    assert len(reached) == 7968
    assert {s.crossings for s in reached} == {c for c in signed_codes(4) if euler_number(c) == 2}


def test_from_crossings_takes_the_drawable_codes_and_no_other(states_by_crossings):
    for code in signed_codes(2):
        if euler_number(code) == 2:
            assert TopologicalState.from_crossings(code) in states_by_crossings[2]
        else:
            with pytest.raises(InvalidStateError, match="no plane curve"):
                TopologicalState.from_crossings(code)


def test_undo_reverts_every_action(states_by_crossings):
    for states in states_by_crossings[:3]:
        for state in states:
            for action, following in state.actions():
                assert following.undo(action) == state
                assert following.num_crossings > state.num_crossings
    generator = random.Random(3)
    for state in generator.sample(sorted(states_by_crossings[3]), 60):
        for action, following in state.actions():
            assert following.undo(action) == state


def test_predecessors_are_exactly_the_actions_that_lead_here(states_by_crossings):
    leading = {state: set() for states in states_by_crossings for state in states}
    for states in states_by_crossings[:3]:
        for state in states:
            for action, following in state.actions():
                if following in leading:
                    leading[following].add((action, state))
    for state, expected in leading.items():
        found = list(state.predecessors())
        assert len(found) == len(set(found))
        assert set(found) == expected


def test_undo_of_another_action_is_rejected():
    loop = TopologicalState.from_crossings([(2, 1, 1)])
    for action in (R1(0, -1, 1), R1(1, 1, 1), Cross(0, 7, 1), R1(0, 1, -1)):
        with pytest.raises(IllegalActionError, match="does not lead to the state 2o1\\+"):
            loop.undo(action)


def test_text_parses_back_and_is_csv_safe(states_by_crossings):
    for states in states_by_crossings:
        texts = {str(state) for state in states}
        assert len(texts) == len(states)
        assert not set("".join(texts)) & set(", \t\n\"'=;")
        assert {TopologicalState.parse(text) for text in texts} == states
    assert str(TopologicalState.trivial()) == "trivial"
    assert str(TopologicalState.from_crossings([(4, 1, 1), (6, 3, 1), (2, 5, 1)])) == "4o1+2o5+6o3+"


def test_crossings_are_sorted_by_first_position():
    crossings = [(6, 3, 1), (4, 1, 1), (2, 5, 1)]
    for permuted in itertools.permutations(crossings):
        state = TopologicalState.from_crossings([list(crossing) for crossing in permuted])
        assert state.crossings == ((4, 1, 1), (2, 5, 1), (6, 3, 1))
        assert (state.num_crossings, state.num_segments) == (3, 7)


@pytest.mark.parametrize(
    ("crossings", "wrong"),
    [
        ([(1, 2)], "triples of whole numbers"),
        ([(1, 2, 0)], "sign must be \\+1 or -1"),
        ([(1, 2.5, 1)], "triples of whole numbers"),
        ([(1, 3, 1)], "each position from 1 to 2 once, got \\[\\(1, 3, 1\\)\\]"),
        ([(0, 1, 1)], "each position from 1 to 2 once"),
        ([(1, 1, 1)], "each position from 1 to 2 once"),
        ([(1, 2, 1), (2, 3, 1)], "each position from 1 to 4 once"),
        ([(1, 3, 1), (2, 4, 1)], "no plane curve.*need 3 faces"),
        ([(4, 1, 1), (2, 5, 1), (6, 3, -1)], "no plane curve"),
    ],
)
def test_contradictory_crossings_are_rejected(crossings, wrong):
    with pytest.raises(InvalidStateError, match=wrong):
        TopologicalState.from_crossings(crossings)


@pytest.mark.parametrize("text", ["", "4o1", "4o1+x", "o1+", "4u1+2o5+", "1,2,+"])
def test_invalid_text_is_rejected(text):
    with pytest.raises(InvalidStateError, match="is not a state"):
        TopologicalState.parse(text)


def test_text_of_contradictory_crossings_is_rejected():
    with pytest.raises(InvalidStateError, match="each position from 1 to 4 once"):
        TopologicalState.parse("1o2+2o3+")


@settings(deadline=None, max_examples=40)
@given(data=st.data(), length=st.integers(1, 6))
def test_random_plan_can_be_undone(data, length):
    state, plan = TopologicalState.trivial(), []
    for _ in range(length):
        choice = data.draw(st.sampled_from(list(state.actions())))
        plan.append((choice[0], state))
        state = choice[1]
        assert TopologicalState.from_crossings(state.crossings) == state
    for action, before in reversed(plan):
        state = state.undo(action)
        assert state == before


def test_what_is_no_text_and_no_action_is_refused():
    with pytest.raises(InvalidStateError, match="5 is not a state's text"):
        TopologicalState.parse(5)
    with pytest.raises(TypeError, match=r"'R1\(0,1,1\)' is not an action; parse_action"):
        TopologicalState.trivial().apply("R1(0,1,1)")

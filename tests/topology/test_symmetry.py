"""Mirror and Reverse: involutions that commute with everything (Sec. V-A)."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest

from knotflow.topology import R1, R2, Cross, IllegalActionError, TopologicalState, all_states
from knotflow.topology.draw import draw
from knotflow.topology.symmetry import (
    Symmetry,
    distinct_actions,
    mirror,
    mirror_action,
    representative,
    reverse,
    reverse_action,
)


def test_mirror_and_reverse_are_involutions_that_commute(states_by_crossings):
    for states in states_by_crossings:
        for state in states:
            assert mirror(mirror(state)) == state
            assert reverse(reverse(state)) == state
            assert mirror(reverse(state)) == reverse(mirror(state))
            assert mirror(state) in states
            assert reverse(state) in states


@pytest.mark.slow
def test_symmetries_commute_with_actions(states_by_crossings):
    sample = random.Random(1).sample(sorted(states_by_crossings[3]), 40)
    for state in itertools.chain(*states_by_crossings[:3], sample):
        count = state.num_segments
        for action, following in state.actions():
            mirrored, turned = mirror_action(action), reverse_action(action, count)
            assert mirror_action(mirrored) == action
            assert reverse_action(turned, count) == action
            assert mirror_action(turned) == reverse_action(mirrored, count)
            assert mirror(state).apply(mirrored) == mirror(following)
            assert reverse(state).apply(turned) == reverse(following)


def test_what_the_paper_says_of_the_parameters():
    assert mirror_action(R1(2, 1, 1)) == R1(2, -1, -1)
    assert mirror_action(R2(0, 2, 1, 1)) == R2(0, 2, -1, 1)
    assert mirror_action(Cross(2, 0, 1)) == Cross(2, 0, -1)
    assert reverse_action(R1(0, 1, 1), 3) == R1(2, -1, 1)
    assert reverse_action(R2(0, 2, 1, 1), 5) == R2(4, 2, -1, -1)
    assert reverse_action(Cross(2, 0, 1), 5) == Cross(2, 4, 1)


def test_symmetries_of_states_are_those_of_rope_shapes(states_by_crossings):
    for state in random.Random(2).sample(sorted(states_by_crossings[3]), 8):
        points = draw(state)
        flipped = points * np.array([1.0, -1.0, 1.0])
        assert TopologicalState.from_curve(flipped) == mirror(state)
        assert TopologicalState.from_curve(points[::-1]) == reverse(state)


def test_every_symmetry_is_its_own_inverse(states_by_crossings):
    assert len(set(Symmetry.all())) == 4
    for symmetry in Symmetry.all():
        for state in states_by_crossings[2]:
            assert symmetry.of_state(symmetry.of_state(state)) == state
            for action, following in state.actions():
                moved = symmetry.of_action(action, state.num_segments)
                assert symmetry.of_state(state).apply(moved) == symmetry.of_state(following)


def test_four_symmetries_make_all_r1_actions_from_one():
    images = {symmetry.of_action(R1(0, 1, 1), 1) for symmetry in Symmetry.all()}
    assert images == {R1(0, left, sign) for left in (1, -1) for sign in (1, -1)}


def test_reversing_on_a_rope_without_that_segment_is_refused():
    with pytest.raises(IllegalActionError, match="no segment 4 among 3"):
        reverse_action(Cross(4, 2, 1), 3)


def test_a_state_and_its_images_have_one_representative():
    for state in all_states(2):
        first, symmetry = representative(state)
        assert symmetry.of_state(state) == first
        assert {representative(one.of_state(state))[0] for one in Symmetry.all()} == {first}


def test_there_are_396_actions_up_to_symmetry_that_lead_to_at_most_three_crossings():
    """Of 1,584 pairs of state and action, 8 from the trivial state among them: no action is its
    own image, so a quarter."""
    pairs = [
        (state, action)
        for crossings in range(3)
        for state in all_states(crossings)
        if representative(state)[0] == state
        for action, onward in distinct_actions(state)
        if onward.num_crossings <= 3
    ]
    assert len(pairs) == 396

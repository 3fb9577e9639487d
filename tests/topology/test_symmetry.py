"""Mirror and Reverse: involutions that commute with everything (Sec. V-A)."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest

from knotflow.topology import R1, R2, Cross, IllegalActionError, TopologicalState, all_states
from knotflow.topology.draw import draw
from knotflow.topology.symmetry import Symmetry, distinct_actions, representative


def test_mirror_and_reverse_are_involutions_that_commute(states_by_crossings):
    for states in states_by_crossings:
        for state in states:
            assert state.mirrored().mirrored() == state
            assert state.reversed().reversed() == state
            assert state.reversed().mirrored() == state.mirrored().reversed()
            assert state.mirrored() in states
            assert state.reversed() in states


@pytest.mark.slow
def test_symmetries_commute_with_actions(states_by_crossings):
    sample = random.Random(1).sample(sorted(states_by_crossings[3]), 40)
    for state in itertools.chain(*states_by_crossings[:3], sample):
        count = state.num_segments
        for action, following in state.actions():
            mirrored, turned = action.mirrored(), action.reversed(count)
            assert mirrored.mirrored() == action
            assert turned.reversed(count) == action
            assert turned.mirrored() == mirrored.reversed(count)
            assert state.mirrored().apply(mirrored) == following.mirrored()
            assert state.reversed().apply(turned) == following.reversed()


def test_parameters_of_mirrored_and_reversed_actions():
    assert R1(2, 1, 1).mirrored() == R1(2, -1, -1)
    assert R2(0, 2, 1, 1).mirrored() == R2(0, 2, -1, 1)
    assert Cross(2, 0, 1).mirrored() == Cross(2, 0, -1)
    assert R1(0, 1, 1).reversed(3) == R1(2, -1, 1)
    assert R2(0, 2, 1, 1).reversed(5) == R2(4, 2, -1, -1)
    assert Cross(2, 0, 1).reversed(5) == Cross(2, 4, 1)


def test_symmetries_of_states_match_rope_shapes(states_by_crossings):
    for state in random.Random(2).sample(sorted(states_by_crossings[3]), 8):
        points = draw(state)
        flipped = points * np.array([1.0, -1.0, 1.0])
        assert TopologicalState.from_curve(flipped) == state.mirrored()
        assert TopologicalState.from_curve(points[::-1]) == state.reversed()


@pytest.mark.slow
def test_every_symmetry_is_its_own_inverse(states_by_crossings):
    assert len(set(Symmetry.all())) == 4
    for symmetry in Symmetry.all():
        for state in states_by_crossings[2]:
            assert symmetry.of_state(symmetry.of_state(state)) == state
            for action, following in state.actions():
                moved = symmetry.of_action(action, state.num_segments)
                assert symmetry.of_state(state).apply(moved) == symmetry.of_state(following)


def test_symmetries_relate_all_r1_actions():
    images = {symmetry.of_action(R1(0, 1, 1), 1) for symmetry in Symmetry.all()}
    assert images == {R1(0, left, sign) for left in (1, -1) for sign in (1, -1)}


def test_reversing_a_missing_segment_is_rejected():
    with pytest.raises(IllegalActionError, match="no segment 4; this state has segments 0 to 2"):
        Cross(4, 2, 1).reversed(3)


def test_images_share_a_representative():
    for state in all_states(2):
        first, symmetry = representative(state)
        assert symmetry.of_state(state) == first
        assert {representative(one.of_state(state))[0] for one in Symmetry.all()} == {first}


def test_396_distinct_actions_to_three_crossings():
    """Of 1,584 pairs of state and action, 8 from the trivial state among them: no action is its
    own image, so a quarter."""
    pairs = [
        (state, action)
        for crossings in range(3)
        for state in all_states(crossings)
        if representative(state)[0] == state
        for action, after in distinct_actions(state)
        if after.num_crossings <= 3
    ]
    assert len(pairs) == 396

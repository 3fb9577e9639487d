"""Fingers open as wide as neighbours let them."""

import numpy as np
import pytest

from knotflow.planning import Hand, HandConfig
from knotflow.planning.fingers import openings
from knotflow.simulation import RopeConfig, resample, straight
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw

ROPE, HAND = RopeConfig(), HandConfig()


def hairpin(gap):
    """A rope (V, 3) whose halves lie side by side, so far apart."""
    half = np.column_stack([np.linspace(0, 0.4, 20), np.zeros(20)])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 12)[1:-1]
    bend = np.column_stack([0.4 + gap / 2 * np.cos(turn), gap / 2 * (1 + np.sin(turn))])
    plane = np.concatenate([half, bend, half[::-1] + [0, gap]])
    return np.column_stack([plane, np.full(len(plane), ROPE.radius)])


def test_nothing_is_in_the_way_on_a_straight_rope():
    np.testing.assert_allclose(openings(straight(ROPE), range(40), ROPE.radius, HAND), HAND.opening)


@pytest.mark.parametrize(
    ("gap", "room"), [(0.1, 0.05), (0.03, 0.034), (0.025, 0.024), (0.018, 0.0)]
)
def test_a_neighbour_narrows_the_opening_until_the_strand_does_not_fit(gap, room):
    found = openings(hairpin(gap), [8], ROPE.radius, HAND)
    np.testing.assert_allclose(found, room, atol=1e-4)


def test_no_link_under_or_over_another_strand_can_be_grasped():
    state = TopologicalState.parse("4o1+2o5+6o3+")
    points = resample(draw(state), ROPE)
    room = openings(points, range(ROPE.links), ROPE.radius, HAND)
    from knotflow.topology import project

    links = (np.asarray(project(points).fractions) * ROPE.links).astype(int)
    assert (room[links] == 0).all() and (room > 0).sum() > 15


def test_room_is_the_same_wherever_and_however_the_rope_lies(rng):
    points = resample(draw(TopologicalState.parse("2o1+")), ROPE)
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    moved = points @ turn.T + [0.3, -0.2, 0.0]
    here, there = (openings(one, range(40), ROPE.radius, HAND) for one in (points, moved))
    np.testing.assert_allclose(here, there, atol=1e-9)


def test_splines_that_grasp_where_fingers_do_not_fit_are_not_for_the_search():
    points = hairpin(0.018)
    splines = np.tile([0.2, 0.1, 0.1, 0.05, 0.2, 0.1], (2, 1))
    splines[1, 0] = 0.5  # at the turn, where no neighbour is
    assert Hand(ROPE.radius).may_follow(points, splines).tolist() == [False, True]


def test_the_arm_that_carries_a_hand_is_asked_too():
    class Arm:
        def may_follow(self, points, splines):
            return splines[:, 0] < 0.6

        def first_failed(self, plan):
            return 2

    points, hand = hairpin(0.018), Hand(ROPE.radius, arm=Arm())
    splines = np.tile([0.2, 0.1, 0.1, 0.05, 0.2, 0.1], (3, 1))
    splines[:, 0] = 0.2, 0.5, 0.8
    assert hand.may_follow(points, splines).tolist() == [False, True, False]
    assert (hand.first_failed(None), Hand(ROPE.radius).first_failed(None)) == (2, None)


def test_a_hand_is_as_large_in_units_of_the_rope():
    scaled = np.array([*vars(HAND.scaled(2.0)).values()])
    np.testing.assert_allclose(2 * scaled, [*vars(HAND).values()])

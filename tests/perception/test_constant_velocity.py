"""A held rope goes on, drawn along by the gripper; one that is let go stays."""

import numpy as np
import pytest

from knotflow.perception.estimation.chain import project_lengths
from knotflow.perception.tracking.tracker import constant_velocity

from .shapes import ROPE, s_curve

LINK = 12


def lengths(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=1)


def test_a_rope_that_is_let_go_stays():
    points = s_curve()
    assert np.array_equal(constant_velocity(points, np.ones_like(points), 0.1, None, None), points)


def test_a_gripper_that_stands_still_moves_nothing():
    points = s_curve()
    gripper = points[LINK : LINK + 2].mean(axis=0)
    still = constant_velocity(points, np.zeros_like(points), 0.1, gripper, LINK)
    assert np.allclose(still, points, atol=1e-9)


def test_the_held_link_goes_where_the_gripper_is_and_the_rope_keeps_its_length():
    points = s_curve()
    gripper = points[LINK : LINK + 2].mean(axis=0) + [0.03, 0.06, 0.05]
    moved = constant_velocity(points, np.zeros_like(points), 0.1, gripper, LINK)
    assert np.linalg.norm(moved[LINK : LINK + 2].mean(axis=0) - gripper) < 2e-3
    assert np.allclose(lengths(moved), ROPE.link_length, rtol=1e-6)


def test_a_rope_goes_on_at_its_velocity_but_not_for_long():
    points, velocity = s_curve(), np.array([0.1, 0.0, 0.0])
    gripper = points[LINK : LINK + 2].mean(axis=0)
    moved = constant_velocity(points, velocity + 0 * points, 0.1, gripper + 0.1 * velocity, LINK)
    assert np.allclose(moved - points, 0.1 * velocity, atol=1e-9)
    later = constant_velocity(points, velocity + 0 * points, 5.0, gripper, LINK)
    assert np.linalg.norm(later - points, axis=1).max() < 0.03


def test_an_immovable_vertex_stays():
    points = s_curve()
    stretched = points * [1.05, 1.0, 1.0]
    mobility = np.ones(len(points))
    mobility[5] = 1e-6
    shape = project_lengths(stretched, ROPE.link_length, mobility)
    assert np.linalg.norm(shape[5] - stretched[5]) < 1e-5
    assert lengths(shape) == pytest.approx(ROPE.link_length, rel=1e-6)

"""A rope is laid onto its points, and keeps its length."""

import numpy as np
import pytest

from knotflow.perception.estimation.chain import register
from knotflow.simulation import resample

from .shapes import ROPE, loop, s_curve


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_a_rope_that_lies_on_its_points_stays(points):
    found = register(points, resample(points, ROPE), ROPE)
    assert np.linalg.norm(found - points, axis=1).max() < 1e-3


def test_a_rope_that_moved_is_laid_onto_its_points():
    points = s_curve()
    found = register(points - [0.0, 0.03, 0.0], points, ROPE)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    assert np.linalg.norm(np.diff(found, axis=0), axis=1) == pytest.approx(
        ROPE.link_length, rel=1e-5
    )


def test_hidden_vertices_go_along():
    points, shift = s_curve(), np.array([0.0, 0.015, 0.0])
    found = register(points - shift, np.r_[points[:17], points[24:]], ROPE)
    assert (found - points + shift)[17:24, 1].mean() > 0.7 * shift[1]


def test_without_points_a_rope_stays():
    points = s_curve()
    assert np.array_equal(register(points, np.zeros((0, 3)), ROPE), points)

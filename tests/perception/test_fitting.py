"""A shape is found from some way off, and lengths are projected to the nearest equal ones."""

import numpy as np
import pytest

from knotflow.perception.estimation.chain import project_lengths
from knotflow.perception.estimation.fitting import fit

from .shapes import CAMERA, ROPE, loop, s_curve, target


@pytest.mark.slow
@pytest.mark.parametrize("points", [s_curve(), loop()], ids=["flat", "loop"])
def test_a_shape_11_mm_off_is_brought_to_2_mm(points, rng):
    along = np.linspace(0, np.pi, len(points))[:, None]
    off = sum(np.cos(k * along + rng.uniform(0, 6)) * rng.normal(size=3) for k in range(1, 4))
    off[:, 2] *= 0.2
    off *= 0.011 / np.linalg.norm(off, axis=1).mean()
    found = fit(points + off, target(points), CAMERA, ROPE)
    assert np.linalg.norm(found - points, axis=1).mean() < 2e-3
    lengths = np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(lengths, ROPE.link_length, rtol=1e-6)


def test_projected_links_are_equal_and_the_shape_moves_little(rng):
    points = s_curve() + rng.normal(0, 2e-3, (41, 3))
    found = project_lengths(points, ROPE.link_length)
    lengths = np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(lengths, ROPE.link_length, rtol=1e-8)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    np.testing.assert_allclose(found.mean(axis=0), points.mean(axis=0), atol=1e-9)


def test_projecting_an_equal_shape_changes_nothing():
    points = loop()
    np.testing.assert_allclose(project_lengths(points, ROPE.link_length), points, atol=1e-9)

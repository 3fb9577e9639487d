"""Chains of links: overlap, nearest places and registration."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from knotflow.perception.estimation.chain import nearest_places, overlap, register
from knotflow.simulation import resample

from .shapes import ROPE, loop, s_curve


def test_nearest_places_match_sampled_minimum(rng):
    share = np.linspace(0, 1, 60)[:, None]
    for p, d, q, e in rng.normal(size=(30, 4, 3)):
        s, t = nearest_places(*(tuple(one) for one in (p, d, q, e)))
        found = np.linalg.norm(p + s * d - q - t * e)
        least = cdist(p + share * d, q + share * e).min()
        assert found == pytest.approx(least, abs=0.02)
        assert found <= least + 1e-6


def test_overlap_ignores_neighbouring_links():
    folded = np.array([[[0, 0, 0], [1, 0, 0], [1, 0.1, 0], [0, 0.1, 0], [0, 0.2, 0]]], float)
    assert overlap(folded, 0.05)[0].item() == pytest.approx(0.0)  # links 0 and 2 are 0.1 apart
    loss, slope = overlap(folded, 0.1)  # and so are 0 and 3, which would have to be 0.2
    assert loss[0] == pytest.approx(1.0)
    assert slope[0, 0, 1] > 0 > slope[0, 3, 1]


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_register_keeps_aligned_rope(points):
    found = register(points, resample(points, ROPE), ROPE)
    assert np.linalg.norm(found - points, axis=1).max() < 1e-3


def test_register_recovers_translation():
    points = s_curve()
    found = register(points - [0.0, 0.03, 0.0], points, ROPE)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    assert np.linalg.norm(np.diff(found, axis=0), axis=1) == pytest.approx(
        ROPE.link_length, rel=1e-5
    )


def test_hidden_vertices_follow_visible_ones():
    points, shift = s_curve(), np.array([0.0, 0.015, 0.0])
    found = register(points - shift, np.r_[points[:17], points[24:]], ROPE)
    assert (found - points + shift)[17:24, 1].mean() > 0.7 * shift[1]


def test_register_without_points_changes_nothing():
    points = s_curve()
    assert np.array_equal(register(points, np.zeros((0, 3)), ROPE), points)

"""Coherent point drift moves a rope to where its points are."""

import numpy as np

from knotflow.perception.tracking import CpdConfig, CpdTracker, drift

from .shapes import CAMERA, ROPE, image, s_curve

CONFIG = CpdConfig()


def test_drift_recovers_translation():
    points = s_curve()
    found = drift(points - [0.0, 0.015, 0.0], points, ROPE, CONFIG)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    assert np.allclose(np.linalg.norm(np.diff(found, axis=0), axis=1), ROPE.link_length, rtol=1e-5)


def test_hidden_vertices_follow_visible_ones():
    points = s_curve()
    shift = np.array([0.0, 0.015, 0.0])
    shown = np.r_[points[:17], points[24:]]
    found = drift(points - shift, shown, ROPE, CONFIG)
    assert (found - points + shift)[17:24, 1].mean() > 0.6 * shift[1]


def test_update_tracks_rope_in_image():
    points = s_curve()
    tracker = CpdTracker(CAMERA, ROPE, points - [0.0, 0.012, 0.0])
    found = tracker.update(image(points))
    assert np.linalg.norm(found.points - points, axis=1).mean() < 6e-3
    assert found.coverage_fraction > 0.7

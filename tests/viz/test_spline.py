"""Splines are drawn from their control points alone."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from knotflow.simulation import spline_path
from knotflow.viz.spline import draw_spline, spline_bounds
from knotflow.viz.style import BAD, styled

CONTROLS = np.array([[0.0, 0.0, 0.01], [0.3, 0.4, 0.2], [0.5, -0.1, 0.01]])


def test_bounds_match_gripper_path():
    path = spline_path(CONTROLS, np.linspace(0, 1, 2001))
    low, high = spline_bounds(CONTROLS)
    np.testing.assert_allclose(low, path[:, :2].min(axis=0), atol=1e-4)
    np.testing.assert_allclose(high, path[:, :2].max(axis=0), atol=1e-4)


@pytest.mark.parametrize(("release", "lines"), [("arrow", 1), ("o", 2), ("x", 2)])
def test_grasp_and_release_are_marked(release, lines):
    with styled():
        axes = Figure().add_subplot()
        draw_spline(axes, CONTROLS, BAD, release=release)
    assert len(axes.lines) == lines
    np.testing.assert_allclose(axes.lines[0].get_xydata(), CONTROLS[:1, :2])
    assert axes.lines[0].get_color() == BAD
    if release == "arrow":
        ((x, y), end) = axes.patches[-1]._posA_posB
        np.testing.assert_allclose(end, CONTROLS[-1, :2])
        heading, last_leg = end - np.array([x, y]), (CONTROLS[2] - CONTROLS[1])[:2]
        turn = heading[0] * last_leg[1] - heading[1] * last_leg[0]
        assert turn == pytest.approx(0.0, abs=1e-9) and heading @ last_leg > 0

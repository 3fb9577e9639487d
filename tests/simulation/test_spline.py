"""Laws of the 6-D spline."""

import numpy as np
import pytest

from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeConfig,
    SplineError,
    check_splines,
    clip_splines,
    control_points,
    grasped_link,
    spline_path,
    straight,
)

ROPE = RopeConfig()


def test_path_starts_at_grasped_link_and_ends_on_table(rng):
    splines = rng.uniform(SPLINE_LOW, SPLINE_HIGH, (50, 6))
    points = np.repeat(straight(ROPE)[None], 50, axis=0)
    controls = control_points(points, splines, ROPE.radius)
    path = spline_path(controls, np.linspace(0, 1, 11))
    link = grasped_link(splines, ROPE.links)
    centre = (points[np.arange(50), link] + points[np.arange(50), link + 1]) / 2
    np.testing.assert_allclose(path[:, 0], centre)
    np.testing.assert_allclose(path[:, -1, :2], splines[:, 4:])
    np.testing.assert_allclose(path[:, -1, 2], ROPE.radius)
    np.testing.assert_allclose(controls[:, 1], splines[:, 1:4])


def test_path_is_tangent_to_control_polygon(rng):
    controls = rng.normal(size=(20, 3, 3))
    path = spline_path(controls, np.array([0, 1e-6, 1 - 1e-6, 1]))
    for step, leg in (
        (path[:, 1] - path[:, 0], controls[:, 1] - controls[:, 0]),
        (path[:, 3] - path[:, 2], controls[:, 2] - controls[:, 1]),
    ):
        cosine = (step * leg).sum(1) / np.linalg.norm(step, axis=1) / np.linalg.norm(leg, axis=1)
        np.testing.assert_allclose(cosine, 1, atol=1e-4)


@pytest.mark.parametrize(
    ("grasp", "link"), [(0.0, 0), (0.024, 0), (0.026, 1), (0.5, 20), (1.0, 39)]
)
def test_grasp_position_selects_link(grasp, link):
    assert grasped_link(np.array([grasp, 0, 0, 0, 0, 0]), 40) == link


def test_ranges_of_spline_numbers():
    middle = (SPLINE_LOW + SPLINE_HIGH) / 2
    check_splines(np.stack([SPLINE_LOW, SPLINE_HIGH, middle]))
    for column in range(6):
        for wrong in (SPLINE_LOW[column] - 0.01, SPLINE_HIGH[column] + 0.01, np.nan):
            spline = middle.copy()
            spline[column] = wrong
            with pytest.raises(SplineError, match=r"must lie in"):
                check_splines(spline)
            if np.isfinite(wrong):
                check_splines(clip_splines(spline))


def test_error_names_spline_and_number():
    splines = np.tile((SPLINE_LOW + SPLINE_HIGH) / 2, (3, 1))
    splines[1, 3] = 2.0
    with pytest.raises(SplineError, match=r"spline\[1\] has mid_z = 2, which must lie in \[0.02"):
        check_splines(splines)

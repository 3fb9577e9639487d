"""Laws of the 6-D spline."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeConfig,
    SplineError,
    check_splines,
    clip_splines,
    control_points,
    grasped_link,
    spline_basis,
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


def test_path_leaves_towards_the_middle_and_arrives_from_it(rng):
    controls = rng.normal(size=(20, 3, 3))
    path = spline_path(controls, np.array([0, 1e-3, 1 - 1e-3, 1]))[..., :2]
    plane = controls[..., :2]
    for step, leg in (
        (path[:, 1] - path[:, 0], plane[:, 1] - plane[:, 0]),
        (path[:, 3] - path[:, 2], plane[:, 2] - plane[:, 1]),
    ):
        cosine = (step * leg).sum(1) / np.linalg.norm(step, axis=1) / np.linalg.norm(leg, axis=1)
        np.testing.assert_allclose(cosine, 1, atol=1e-3)


def test_plane_path_is_the_cubic_b_spline_of_triple_ends():
    coefficients = np.eye(3)[[0, 0, 0, 1, 2, 2, 2]]
    curve = BSpline(np.arange(-3.0, 8.0), coefficients, 3)
    t = np.linspace(0, 1, 41)
    np.testing.assert_allclose(spline_basis(t), curve(4 * t), atol=1e-12)


def test_gripper_rises_and_falls_at_45_degrees_and_is_level_between():
    controls = np.array([[0.0, 0.0, 0.005], [0.2, 0.3, 0.1], [0.4, 0.0, 0.005]])
    path = spline_path(controls, np.linspace(0, 1, 401))
    steps = np.diff(path, axis=0)
    slope = steps[:, 2] / np.linalg.norm(steps[:, :2], axis=1)
    rising, level, falling = slope[5:70], slope[150:250], slope[-70:-5]
    np.testing.assert_allclose(rising, 1, atol=1e-2)
    np.testing.assert_allclose(level, 0, atol=1e-9)
    np.testing.assert_allclose(falling, -1, atol=1e-2)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1).std(), 0, atol=1e-5)
    low = spline_path(controls * [0.2, 0.2, 1], np.linspace(0, 1, 401))
    assert low[:, 2].max() < 0.1  # too short a way to rise so high


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
    with pytest.raises(SplineError, match=r"spline\[1\] has height = 2, which must lie in \[0.02"):
        check_splines(splines)


def test_nan_is_not_told_to_be_clipped():
    spline = np.array([0.5, np.nan, 0.2, 0.1, 0.1, 0.3])
    with pytest.raises(SplineError, match="= nan, which must lie in") as raised:
        check_splines(spline)
    assert "clip_splines" not in str(raised.value)

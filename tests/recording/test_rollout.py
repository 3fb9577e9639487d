from __future__ import annotations

import numpy as np
import pytest


def test_arrays_have_the_precision_of_the_file(make_rollout):
    rollout = make_rollout(1)
    assert rollout.points.dtype == rollout.gripper.dtype == np.float32
    assert rollout.spline.dtype == rollout.control_points.dtype == rollout.times.dtype == np.float64
    np.testing.assert_array_equal(np.rint(rollout.times * 1e9) / 1e9, rollout.times)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"points": np.zeros((26, 41, 2))}, "points has shape"),
        ({"points": np.zeros((25, 41, 3))}, "points has shape"),
        ({"gripper": np.zeros((25, 3))}, "gripper has shape"),
        ({"times": np.zeros((26, 1))}, "times has shape"),
        ({"times": np.zeros(26)}, "times must increase"),
        ({"spline": np.zeros(5)}, r"spline has shape \(5,\), needs \(6,\)"),
        ({"control_points": np.zeros(9)}, "control_points has shape"),
    ],
)
def test_bad_rollouts_are_refused_by_number(make_rollout, changes, words):
    with pytest.raises(ValueError, match=f"rollout 7: {words}"):
        make_rollout(7, **changes)


def test_diverged_rollout_may_be_infinite(make_rollout):
    points = np.full((26, 41, 3), 1e300)
    points[3] = np.nan
    rollout = make_rollout(1, outcome="diverged", points=points)
    assert np.isinf(rollout.points[0]).all() and np.isnan(rollout.points[3]).all()

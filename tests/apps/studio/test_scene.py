"""The studio's first camera position."""

import numpy as np
import pytest

from knotflow.apps.studio.scene import CAMERA, FIELD_OF_VIEW, camera_position
from knotflow.simulation import SPLINE_HIGH


@pytest.mark.parametrize("aspect", [0.3, 0.41, 0.9, 1.2, 2.5])
def test_whole_table_is_visible_in_any_window(aspect):
    place = camera_position(aspect)
    ahead = -place / np.linalg.norm(place)
    right = np.array([1.0, 0.0, 0.0])
    corners = SPLINE_HIGH[-1] * np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)])
    depth = (corners - place) @ ahead
    rim = np.tan(FIELD_OF_VIEW / 2) * depth
    assert (abs((corners - place) @ np.cross(right, ahead)) < rim).all()
    assert (abs((corners - place) @ right) < aspect * rim).all()


def test_wide_window_has_default_camera():
    assert camera_position(1.4) == pytest.approx(CAMERA)

"""The camera's geometry, and its file."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from knotflow.perception import Calibration, Camera, CameraError


@pytest.fixture
def oblique() -> Camera:
    down = Rotation.from_euler("x", 215, degrees=True) * Rotation.from_euler("z", 20, degrees=True)
    return Camera(
        320, 200, 300.0, 310.0, 150.0, 111.0, np.array([0.1, -0.8, 1.1]), down.as_matrix()
    )


def test_unproject_inverts_project(oblique, rng):
    points = rng.uniform([-0.6, -0.6, 0.0], [0.6, 0.6, 0.3], (5, 7, 3))
    seen = oblique.project(points)
    assert seen.shape == (5, 7, 3)
    np.testing.assert_allclose(oblique.unproject(seen[..., :2], seen[..., 2]), points, atol=1e-12)


def test_rays_pass_through_what_their_pixels_show(oblique):
    rays = oblique.rays()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    seen = oblique.project(oblique.position + 1.7 * rays)
    np.testing.assert_allclose(seen[40, 123, :2], [123, 40], atol=1e-9)
    np.testing.assert_allclose(seen[-1, -1, :2], [319, 199], atol=1e-9)


def test_points_behind_camera_have_no_pixel(oblique):
    u, v, depth = oblique.project(oblique.position - 0.5 * oblique.rotation[:, 2])
    assert np.isnan([u, v]).all() and depth == pytest.approx(-0.5)


@pytest.mark.parametrize("size", [(320, 240), (640, 480), (240, 240)])
def test_the_overhead_camera_sees_all_that_splines_reach(size):
    camera = Camera.overhead(*size)
    corners = np.array(list(product([-0.6, 0.6], [-0.6, 0.6], [0.0, 0.15])))
    u, v, _ = camera.project(corners).T
    assert (u > -0.5).all() and (u < size[0] - 0.5).all()
    assert (v > -0.5).all() and (v < size[1] - 0.5).all()


def test_the_overhead_camera_shows_x_to_the_right_and_y_upwards():
    camera = Camera.overhead()
    middle, right, up = camera.project([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    np.testing.assert_allclose(middle, [319.5, 239.5, 1.2])
    assert right[0] > middle[0] and right[1] == pytest.approx(middle[1])
    assert up[1] < middle[1] and up[0] == pytest.approx(middle[0])


def test_camera_file_round_trip(oblique, tmp_path):
    oblique.save(tmp_path / "camera.yaml")
    again = Calibration.load(tmp_path / "camera.yaml").camera()
    for name, value in vars(oblique).items():
        np.testing.assert_array_equal(getattr(again, name), value)


def change(tmp_path, **values):
    path = tmp_path / "camera.yaml"
    Camera.overhead().save(path)
    content = yaml.safe_load(path.read_text()) | values
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v != "left out"}))
    return path


@pytest.mark.parametrize("name", ["width", "fx", "cy", "position", "rotation"])
def test_incomplete_camera_file_names_value(name, tmp_path):
    for absent in ("left out", None):
        with pytest.raises(CameraError, match=f"lacks {name}"):
            Calibration.load(change(tmp_path, **{name: absent})).camera()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fx": "wide"}, "fx must be numeric"),
        ({"fx": [200, 200]}, "fx is one number"),
        ({"fy": -200.0}, "fy is positive"),
        ({"width": 320.5}, "width is a whole number"),
        ({"position": [0, 0]}, r"position has shape \(3,\)"),
        ({"position": [0, 0, float("nan")]}, "position must be finite"),
        ({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "rotation has orthogonal columns"),
        ({"k1": 0.1}, "has distortion"),
        ({"position": [0.0, 0.0, 1200.0]}, "1.2e\\+03 m from the origin.*millimetres.*by 1000"),
    ],
)
def test_invalid_camera_value_raises(values, message, tmp_path):
    with pytest.raises(CameraError, match=message):
        Calibration.load(change(tmp_path, **values)).camera()


def test_non_camera_file_raises(tmp_path):
    (tmp_path / "list.yaml").write_text("- 1\n- 2\n")
    for name in ("list.yaml", "absent.yaml"):
        with pytest.raises(CameraError, match=name):
            Calibration.load(tmp_path / name).camera()


@pytest.mark.parametrize(("width", "grid"), [(160, 1), (320, 2), (640, 4), (960, 6)])
def test_binning(width, grid):
    camera, flat = Camera.overhead(width, width * 3 // 4), np.zeros((3, 3))
    assert camera.binning(flat, 0.016, 1.4) == grid
    assert camera.binning(flat + [0, 0, 2.0], 0.016, 1.4) == 1  # behind it
    assert 16 <= camera.binned(camera.binning(flat, 10.0, 1.0)).height < 32


def test_a_binned_camera_sees_squares_of_pixels():
    camera = Camera.overhead()
    coarse = camera.binned(2)
    assert (coarse.width, coarse.height) == (320, 240)
    points = np.random.default_rng(0).uniform([-0.5, -0.4, 0], [0.5, 0.4, 0.1], (20, 3))
    fine, seen = camera.project(points), coarse.project(points)
    assert np.allclose((fine[:, :2] + 0.5) / 2, seen[:, :2] + 0.5)
    assert np.allclose(fine[:, 2], seen[:, 2])

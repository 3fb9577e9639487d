"""Camera files of other programs: all say the same, each in its way."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from knotflow.perception import Calibration, CameraError

FX, FY, CX, CY = 610.5, 612.25, 321.0, 238.5
K = [FX, 0.0, CX, 0.0, FY, CY, 0.0, 0.0, 1.0]
K_COLUMNS = [FX, 0.0, 0.0, 0.0, FY, 0.0, CX, CY, 1.0]
D = [0.1, -0.05, 1e-3, -2e-3, 0.01]
POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_euler("xz", [200, 30], degrees=True).as_matrix()
POSE[:3, 3] = 0.3, -0.2, 0.9
X, Y, Z, W = Rotation.from_matrix(POSE[:3, :3]).as_quat().tolist()
INVERSE = np.linalg.inv(POSE)

OPENCV = f"""%YAML:1.0
---
calibration_time: "Thu 26 Nov 2026"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FX}, 0., {CX}, 0., {FY}, {CY}, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.0e-1, -5e-02, 1e-3, -2e-3, 1e-2 ]
avg_reprojection_error: 0.2
"""
ROS_TOPIC = yaml.safe_dump_all(
    2
    * [
        {
            "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "camera_optical_frame"},
            "height": 480,
            "width": 640,
            "distortion_model": "plumb_bob",
            "d": D,
            "k": K,
            "r": np.eye(3).ravel().tolist(),
            "p": [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0],
            "binning_x": 0,
            "binning_y": 0,
            "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
        }
    ],
    explicit_start=True,
)
ROS_CALIBRATION = yaml.safe_dump(
    {
        "image_width": 640,
        "image_height": 480,
        "camera_name": "narrow_stereo",
        "camera_matrix": {"rows": 3, "cols": 3, "data": K},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": D},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": np.eye(3).ravel().tolist()},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [0.0] * 12},
    }
)
REALSENSE = json.dumps(
    {
        "intrinsics": {
            "width": 640, "height": 480, "ppx": CX, "ppy": CY, "fx": FX, "fy": FY,
            "model": "distortion.brown_conrady", "coeffs": D,
        },
        "depth_scale": 0.00025,
    }
)  # fmt: skip
OPEN3D = json.dumps(
    {"width": 640, "height": 480, "intrinsic_matrix": K_COLUMNS, "depth_scale": 4000.0}, indent="\t"
)
OPEN3D_PARAMETERS = json.dumps(
    {
        "class_name": "PinholeCameraParameters",
        "extrinsic": INVERSE.T.ravel().tolist(),
        "intrinsic": {"height": 480, "width": 640, "intrinsic_matrix": K_COLUMNS},
        "version_major": 1,
        "version_minor": 0,
    }
)
OURS = {"width": 640, "height": 480, "fx": FX, "fy": FY, "cx": CX, "cy": CY}


def load(tmp_path, text) -> Calibration:
    path = tmp_path / "camera.txt"
    path.write_text(text if isinstance(text, str) else yaml.safe_dump(text), "utf-8")
    return Calibration.load(path)


@pytest.mark.parametrize(
    ("text", "distorted", "unit"),
    [
        pytest.param(OPENCV, True, None, id="opencv"),
        pytest.param(ROS_TOPIC, True, None, id="ros topic"),
        pytest.param(ROS_CALIBRATION, True, None, id="ros camera_calibration"),
        pytest.param(REALSENSE, True, 0.00025, id="realsense"),
        pytest.param(OPEN3D, False, 0.00025, id="open3d"),
        pytest.param(OPEN3D_PARAMETERS, False, None, id="open3d parameters"),
        pytest.param(OURS | dict(zip(("k1", "k2", "p1", "p2", "k3"), D, strict=True)), True, None),
        pytest.param(OURS | {"distortion": [0.0] * 5}, False, None),
    ],
)
def test_file_of_each_kind(text, distorted, unit, tmp_path):
    found = load(tmp_path, text)
    assert found.size == (640, 480)
    np.testing.assert_allclose([*found.focal, *found.centre], [FX, FY, CX, CY])
    np.testing.assert_allclose(found.distortion[:5], D if distorted else [])
    assert found.depth_unit == unit and found.model == ""


def test_messages_and_realsense_objects():
    ros2 = SimpleNamespace(
        width=640, height=480, k=np.array(K), d=D, distortion_model="plumb_bob", binning_x=0,
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    )  # fmt: skip
    ros1 = SimpleNamespace(width=640, height=480, K=K, D=D, distortion_model="plumb_bob")
    realsense = SimpleNamespace(
        width=640, height=480, fx=FX, fy=FY, ppx=CX, ppy=CY, model=4, coeffs=D
    )
    for message in (ros2, ros1, realsense):
        found = Calibration.of(message)
        assert found.size == (640, 480) and found.model == ""
        np.testing.assert_allclose([*found.focal, *found.centre, *found.distortion], [
            FX, FY, CX, CY, *D
        ])  # fmt: skip


@pytest.mark.parametrize(
    "pose",
    [
        {"position": [0.3, -0.2, 0.9], "rotation": POSE[:3, :3].tolist()},
        {"position": [0.3, -0.2, 0.9], "quaternion": {"x": X, "y": Y, "z": Z, "w": W}},
        {"pose": POSE.tolist()},
        {"camera_to_world": POSE[:3].tolist()},
        {"extrinsic": INVERSE.tolist()},
        {"extrinsic": INVERSE.T.ravel().tolist()},
        {"extrinsics": {"rotation": INVERSE[:3, :3].ravel().tolist(),
                        "translation": INVERSE[:3, 3].tolist()}},
        {"rvec": Rotation.from_matrix(INVERSE[:3, :3]).as_rotvec().tolist(),
         "tvec": INVERSE[:3, 3:].tolist()},
        {"pose": {"position": {"x": 0.3, "y": -0.2, "z": 0.9},
                  "orientation": {"x": X, "y": Y, "z": Z, "w": W}}},
        {"transform": {"translation": {"x": 0.3, "y": -0.2, "z": 0.9},
                       "rotation": {"x": X, "y": Y, "z": Z, "w": W}}},
    ],
)  # fmt: skip
def test_pose_in_each_form(pose, tmp_path):
    (found,) = load(tmp_path, OURS | pose).poses
    np.testing.assert_allclose(found, POSE, atol=1e-9)


def test_quaternion_without_names_may_be_in_either_order(tmp_path):
    for order in ([X, Y, Z, W], [W, X, Y, Z]):
        found = load(tmp_path, OURS | {"position": [0.3, -0.2, 0.9], "rotation": order})
        assert len(found.poses) == 2
        assert any(np.allclose(one, POSE) for one in found.poses)


@pytest.mark.parametrize("order", [[1, 0, 0, 0], [0, 0, 0, 1]])
def test_no_turn_at_the_origin_is_no_pose_in_either_order(order, tmp_path):
    assert load(tmp_path, OURS | {"position": [0, 0, 0], "rotation": order}).poses == ()


def test_identity_is_no_pose(tmp_path):
    assert load(tmp_path, OURS | {"extrinsic": np.eye(4).tolist()}).poses == ()


@pytest.mark.parametrize(
    ("model", "coefficients", "at"),
    [
        # x / z = 0.5, y / z = 0.25, r^2 = 0.3125, by the formulas of OpenCV's documentation.
        ("plumb_bob", [-0.2, 0.0, 0.0, 0.0, 0.0], (0.46875, 0.234375)),
        ("plumb_bob", [0.0, 0.0, 0.02, 0.04, 0.0], (0.5375, 0.26875)),
        ("rational_polynomial", [0.0, 0, 0, 0, 0, 0.2, 0, 0], (0.470588, 0.235294)),
        ("equidistant", [0.1, 0.0, 0.0, 0.0], (0.466817, 0.233408)),
    ],
)
def test_distortion_moves_pixels_as_its_model_says(model, coefficients, at, tmp_path):
    intrinsics = {"width": 201, "height": 161, "fx": 150, "fy": 150, "cx": 100, "cy": 80}
    text = intrinsics | {"distortion_model": model, "d": coefficients}
    calibration = load(tmp_path, text)
    image = np.zeros((161, 201))
    u, v = 150 * np.array(at) + [100, 80]
    image[int(v) : int(v) + 2, int(u) : int(u) + 2] = 1.0
    found = np.argwhere(calibration.undistorted(image) > 0.5)
    assert np.abs(found.mean(axis=0) - [117.5, 175]).max() < 1.0


def test_fisheye_coefficients_have_names_of_their_own(tmp_path):
    named = {"k1": 0.1, "k2": 0.02, "k3": 0.003, "k4": 0.0004}
    calibration = load(tmp_path, OURS | named | {"distortion_model": "equidistant"})
    np.testing.assert_array_equal(calibration.distortion, [0.1, 0.02, 0.003, 0.0004])


def test_undistorting_undoes_distorting(tmp_path):
    calibration = load(tmp_path, OURS | {"d": [-0.25, 0.08, 1e-3, -5e-4, 0.0]})
    v, u = np.indices((480, 640)).astype(float)
    image = np.sin(u / 25) + np.cos(v / 31)
    other = replace(calibration, model="inverse")
    for first, second in ((calibration, other), (other, calibration)):
        again = second.undistorted(first.undistorted(image))
        seen = np.isfinite(again)
        assert seen.mean() > 0.6
        assert np.abs(again - image)[seen].max() < 5e-3
    assert np.abs(calibration.undistorted(image) - image)[20, 20] > 0.1


def test_colours_beyond_the_image_go_on_as_at_its_border(tmp_path):
    calibration = load(tmp_path, OURS | {"d": [0.1, 0.0, 0.0, 0.0, 0.0]})
    flat = np.full((480, 640, 3), 150, np.uint8)
    assert (calibration.undistorted(flat) == 150).all()
    assert np.isnan(calibration.undistorted(flat[..., 0].astype(float))).any()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"d": [0.1, 0.0, 0.0, 0.0, 0.0]}, "has distortion: undistort the images"),
        ({}, "has no pose: add its position and rotation"),
        ({"position": [0, 0, 1], "rotation": [0.6, 0, 0, 0.8]}, "name them, as in {x: 1"),
        ({"position": [0, 0, -0.8], "rotation": np.eye(3).tolist()}, "does not look down"),
        ({"position": [0, 0, 0.8], "rotation": np.eye(3).tolist()}, "does not look down"),
    ],
)
def test_a_camera_without_depth_looks_down_from_one_pose(values, message, tmp_path):
    bare = {name: OURS[name] for name in ("width", "height", "fx", "fy", "cx", "cy")}
    with pytest.raises(CameraError, match=f"camera.txt: .*{message}"):
        load(tmp_path, bare | values).camera()


def test_braces_are_yaml_too(tmp_path):
    text = "{width: 800, height: 600, fx: 700, fy: 700, cx: 400, cy: 300}"
    assert load(tmp_path, text).size == (800, 600)


def test_scaled_camera_sees_the_same_directions(tmp_path):
    full = load(tmp_path, OURS)
    half = full.scaled(320, 240)
    camera, small = full.at(POSE), half.at(POSE)
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 0], [0.2, 0.2, 0.1], (20, 3))
    np.testing.assert_allclose(
        (camera.project(points)[:, :2] + 0.5) / 2, small.project(points)[:, :2] + 0.5
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fx": None}, "lacks fx"),
        ({"height": None}, "lacks height"),
        ({"fx": "wide"}, "fx must be numeric"),
        ({"camera_matrix": [1, 2, 3]}, "a camera matrix has 9 numbers"),
        ({"k": [0.0] * 9}, "fx is positive"),
        ({"position": [0, 0, 1]}, "lacks rotation; .* without either the table is found"),
        ({"quaternion": [0, 0, 0, 1]}, "lacks position"),
        ({"position": [0, 0, 1], "rotation": [1, 0, 0]}, "is a quaternion"),
        ({"position": [0, 0, 1], "rotation": [9, 0, 0, 1]}, "a quaternion has length 1"),
        ({"pose": [[1, 0], [0, 1]]}, "a pose is a matrix of 16 numbers"),
        ({"model": "ftheta", "coeffs": [0.1]}, "undistort them before"),
        ({"depth_scale": 0}, "depth_scale is positive"),
        ({"roi": {"x_offset": 10, "y_offset": 0}}, "region of the image"),
        ({"roi": {"x_offset": 0, "y_offset": 0, "width": 320}}, "region of the image"),
        ({"resolution": [640]}, "the resolution has 2 numbers"),
        ({"resolution": [640, 480, 3]}, "the resolution has 2 numbers"),
    ],
)
def test_invalid_file_names_what_is_wrong(values, message, tmp_path):
    text = {name: one for name, one in (OURS | values).items() if one is not None}
    with pytest.raises(CameraError, match=f"camera.txt: .*{message}"):
        load(tmp_path, text)


def test_calibration_of_other_proportions_raises(tmp_path):
    with pytest.raises(CameraError, match="640x480, in other proportions: give the whole image"):
        load(tmp_path, OURS).scaled(640, 360)
    sizeless = {name: one for name, one in OURS.items() if name not in ("width", "height")}
    with pytest.raises(CameraError, match="add width and height"):
        load(tmp_path, sizeless).scaled(1280, 960)
    assert load(tmp_path, sizeless).scaled(640, 480).size == (640, 480)


def test_a_region_that_is_the_whole_image_is_none(tmp_path):
    whole = {"x_offset": 0, "y_offset": 0, "width": 640, "height": 480}
    assert load(tmp_path, OURS | {"roi": whole}).size == (640, 480)


def test_an_image_without_pixels_has_no_calibration(tmp_path):
    with pytest.raises(CameraError, match="an image has pixels, got 0x0"):
        load(tmp_path, OURS).scaled(0, 0)

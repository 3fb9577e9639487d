"""Images as cameras write them: sizes, units and poses, on rendered ones and on real ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from knotflow.perception import (
    Appearance,
    Calibration,
    Camera,
    CameraError,
    CameraNoiseConfig,
    ImageError,
    RgbdImage,
    SimulatedCamera,
    read_capture,
)

from .shapes import ROPE, s_curve

REAL = Path(__file__).parents[3] / "shared" / "real" / "cases"
TURN = Rotation.from_euler("zx", [40, 215], degrees=True).as_matrix()
EYE = Camera(160, 120, 150.0, 151.0, 82.0, 57.0, np.array([0.4, 0.35, 0.7]), TURN)
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def pose_of(camera: Camera) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation, camera.position
    return pose


POSE = pose_of(EYE)
CALIBRATION = Calibration((150.0, 151.0), (82.0, 57.0), (160, 120), poses=(POSE,), source="c.yaml")
NO_POSE = replace(CALIBRATION, poses=())


@pytest.fixture(scope="module")
def image() -> RgbdImage:
    noise, look = CameraNoiseConfig(), Appearance()
    return SimulatedCamera(EYE, ROPE, noise, look).capture(s_curve(), np.random.default_rng(0))


@pytest.fixture
def read(image, tmp_path):
    """Reads the image after its files were written with depth in a unit, metres."""

    def reads(calibration, unit=1e-3, rgb=image.rgb, depth=image.depth, depth_unit=None):
        Image.fromarray(rgb).save(tmp_path / "rgb.png")
        if unit < 0.1:
            raw = np.nan_to_num(depth / unit).round().astype(np.uint16)
            Image.fromarray(raw).save(tmp_path / "depth.png")
        else:
            np.save(tmp_path / "depth.npy", depth)
        name = "depth.png" if unit < 0.1 else "depth.npy"
        return read_capture(tmp_path / "rgb.png", tmp_path / name, calibration, depth_unit)

    return reads


def heights(capture) -> np.ndarray:
    return capture.camera.points(capture.image.depth)[..., 2]


@pytest.mark.parametrize("unit", [1.0, 1e-3, 2.5e-4, 1e-4])
def test_unit_of_depth_is_recognised_by_the_pose(unit, read, image):
    seen = read(CALIBRATION, unit)
    np.testing.assert_allclose(seen.image.depth, image.depth, atol=0.6e-3)
    assert "by the pose" in seen.notes[0] and not seen.unit_assumed


@pytest.mark.filterwarnings("error")
def test_a_camera_on_the_table_is_refused(read):
    with pytest.raises(CameraError, match=r"c.yaml: with this pose .* above z = 0"):
        read(replace(CALIBRATION, poses=(pose_of(replace(EYE, position=np.zeros(3))),)))


def test_unit_of_depth_in_the_camera_file_wins_and_the_option_before_it(read, image):
    wrong = replace(NO_POSE, depth_unit=2e-3)
    assert np.allclose(read(wrong).image.depth, 2 * image.depth, atol=2e-3, equal_nan=True)
    asked = read(wrong, 2.5e-4, depth_unit=2.5e-4)
    assert np.allclose(asked.image.depth, image.depth, atol=2e-3, equal_nan=True)
    assert asked.notes[0] == "depth is in units of 0.25 mm, as given"


def test_unit_of_depth_without_pose_is_the_usual_one_or_asked_for(read, image):
    for unit in (1.0, 1e-3):
        seen = read(NO_POSE, unit)
        assert np.allclose(seen.image.depth, image.depth, atol=1e-3, equal_nan=True)
        assert seen.unit_assumed
    with pytest.raises(ImageError, match=r"depth.png: the median .* --depth-unit, as in 0.25mm"):
        read(NO_POSE, 2.5e-4)


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_a_unit_with_which_there_is_no_table_is_refused(unit, read):
    with pytest.raises(ImageError, match="depth.png: with units of .* but a table is 0.05 to"):
        read(NO_POSE, depth_unit=unit)


def test_a_table_is_not_found_in_a_few_pixels(read, image):
    depth = np.full_like(image.depth, np.nan)
    depth[10] = image.depth[10]
    with pytest.raises(ImageError, match="no table is found: 0.8% of its pixels have a depth"):
        read(NO_POSE, depth=depth, depth_unit=1e-3)


@pytest.mark.parametrize("factor", [2, 3])
def test_depth_of_another_size_is_scaled_to_the_colour_image(factor, read, image):
    seen = read(CALIBRATION, depth=image.depth[factor // 2 :: factor, factor // 2 :: factor])
    assert seen.image.depth.shape == (120, 160)
    assert abs(np.nanmedian(heights(seen))) < 5e-3
    assert "depth is scaled to 160x120" in seen.notes[1]


def test_calibration_of_another_size_is_scaled(read):
    seen = read(CALIBRATION.scaled(640, 480))
    assert seen.camera.fx == pytest.approx(EYE.fx) and seen.camera.cx == pytest.approx(EYE.cx)
    assert "calibration is scaled" in seen.notes[1]


def test_unregistered_depth_raises(read, image):
    with pytest.raises(ImageError, match="160x120 pixels but depth 160x90.*aligned to colour"):
        read(CALIBRATION, depth=image.depth[15:-15])
    with pytest.raises(CameraError, match=r"c\.yaml: the image is 160x120.*other proportions"):
        read(replace(CALIBRATION, size=(160, 90)))


@pytest.mark.parametrize("mode", ["RGB", "L"])
def test_picture_of_depth_raises(mode, image, tmp_path):
    Image.fromarray(image.rgb).save(tmp_path / "rgb.png")
    Image.fromarray(image.rgb).convert(mode).save(tmp_path / "depth.png")
    with pytest.raises(ImageError, match="depth.png: is a picture of depth.*16 bits"):
        read_capture(tmp_path / "rgb.png", tmp_path / "depth.png", CALIBRATION)


def test_lens_distortion_is_taken_out(read, image):
    lens = replace(CALIBRATION, distortion=np.array([-0.2, 0.05, 0.0, 0.0, 0.0]))
    bent = replace(lens, model="inverse")
    seen = read(
        lens, rgb=bent.undistorted(image.rgb), depth=bent.undistorted(image.depth, nearest=True)
    )
    both = np.isfinite(seen.image.depth) & np.isfinite(image.depth)
    off = np.abs(seen.image.depth - image.depth)[both]
    assert both.mean() > 0.7 and np.median(off) < 3e-3
    assert seen.notes[1] == "lens distortion is taken out by the file's coefficients"
    straight = read(CALIBRATION, depth=bent.undistorted(image.depth, nearest=True))
    bulge, flat = (np.nanmean(np.abs(heights(one))) for one in (straight, seen))
    assert flat < 0.7 * bulge


def test_pose_with_z_down_is_turned(read):
    seen = read(replace(CALIBRATION, poses=(FLIP @ POSE,)))
    np.testing.assert_allclose(seen.camera.position, EYE.position)
    assert "the pose's z points down: y and z are reversed" in seen.notes


def test_order_of_a_quaternion_is_that_with_a_table(read):
    other = np.eye(4)
    other[:3, :3], other[:3, 3] = TURN.T @ FLIP[:3, :3], POSE[:3, 3]
    seen = read(replace(CALIBRATION, poses=(other, POSE)))
    np.testing.assert_allclose(seen.camera.rotation, TURN)
    assert any("the quaternion is w, x, y, z" in note for note in seen.notes)
    turned = POSE.copy()
    turned[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix() @ TURN
    with pytest.raises(CameraError, match="the table tells neither.*name them"):
        read(replace(CALIBRATION, poses=(turned, POSE)))


def inverse(pose):
    return np.linalg.inv(pose)


def millimetres(pose):
    return np.column_stack([pose[:, :3], pose[:, 3] * [1e3, 1e3, 1e3, 1.0]])


def opengl(pose):
    return pose @ FLIP


def body(pose):
    return pose @ np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("written", "cure"),
    [
        (inverse, "its inverse fits .*`extrinsic` camera from world"),
        (millimetres, "a position in millimetres, so divided by 1000, fits"),
        (opengl, "OpenGL.*negate the rotation's second and third columns, fits"),
        (body, "pose of its optical frame, fits"),
        (lambda pose: inverse(millimetres(pose)), "its inverse and a position in millimetres"),
        (lambda pose: pose + np.eye(4, k=1) * 0.2, "a camera's rotation has orthogonal"),
        (lambda pose: pose + 0.3 * np.outer([0, 0, 1, 0], [0, 0, 0, 1]), "without a pose in"),
    ],
)
@pytest.mark.parametrize("unit", [None, 1e-3])
def test_pose_off_the_table_raises_with_the_cure_that_applies(written, cure, unit, read):
    with pytest.raises(CameraError, match=f"^c.yaml: .*{cure}"):
        read(replace(CALIBRATION, poses=(written(POSE),)), depth_unit=unit)


def test_of_an_upright_camera_the_reading_with_z_up_is_named(tmp_path):
    """Seen from straight above, the inverse of an OpenGL pose has the table at z = 0, too, but from
    below."""
    eye = Camera.overhead(160, 120)
    camera = SimulatedCamera(eye, ROPE, CameraNoiseConfig(), Appearance())
    seen = camera.view(s_curve(), s_curve()[20])
    Image.fromarray(seen.image.rgb).save(tmp_path / "rgb.png")
    np.save(tmp_path / "depth.npy", seen.image.depth)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = eye.rotation, eye.position
    calibration = Calibration((eye.fx, eye.fy), (eye.cx, eye.cy), (160, 120), poses=(opengl(pose),))
    with pytest.raises(CameraError, match="OpenGL") as caught:
        read_capture(tmp_path / "rgb.png", tmp_path / "depth.npy", calibration)
    assert "inverse" not in str(caught.value)


@pytest.mark.parametrize("eye", [EYE, Camera.overhead(160, 120)])
def test_table_is_found_without_a_pose(eye, tmp_path):
    noise, rng = CameraNoiseConfig(), np.random.default_rng(1)
    view = SimulatedCamera(eye, ROPE, noise, Appearance()).view(s_curve(), s_curve()[20])
    seen = SimulatedCamera(eye, ROPE, noise, Appearance()).capture(s_curve(), rng, s_curve()[20])
    Image.fromarray(seen.rgb).save(tmp_path / "rgb.png")
    np.save(tmp_path / "depth.npy", seen.depth)
    calibration = Calibration((eye.fx, eye.fy), (eye.cx, eye.cy), (160, 120))
    found = read_capture(tmp_path / "rgb.png", tmp_path / "depth.npy", calibration)
    assert "the table is found in the depth image" in found.notes[-1]
    true = eye.points(view.image.depth)[..., 2]
    there = found.camera.points(view.image.depth)[..., 2]
    assert np.nanmax(np.abs(there - true)) < 2e-3
    middle = found.camera.on_plane(np.ones((120, 160), bool), 0.0).reshape(120, 160, 2)[
        59:61, 79:81
    ]
    assert np.abs(middle.mean((0, 1))).max() < 2e-3
    assert found.camera.rotation[1, 0] == pytest.approx(0.0, abs=1e-9)  # the image's right is x
    assert found.camera.rotation[0, 0] > 0


def test_image_without_a_table_raises(read, image):
    rng = np.random.default_rng(0)
    with pytest.raises(ImageError, match=r"no table is found.*add the camera's pose"):
        read(NO_POSE, depth=rng.uniform(0.5, 2.0, image.depth.shape).astype(np.float32))


@pytest.mark.skipif(not REAL.is_dir(), reason="the real images are not here")
@pytest.mark.parametrize(
    "name", ["laid_rope_view3", "two_taped_ends_view0", "two_taped_ends_view2", "u_rope"]
)
def test_table_of_real_images(name):
    (rgb,) = REAL.glob(f"{name}.[jp]*g")
    depth = REAL / f"{name}-depth.png"
    calibration = Calibration.load(REAL / f"{name}-camera.yaml")
    posed = read_capture(rgb, depth, calibration)
    found = read_capture(rgb, depth, replace(calibration, poses=()))
    apart = heights(found) - heights(posed)
    assert np.nanquantile(np.abs(apart), 0.99) < 3e-3
    assert found.camera.position[2] == pytest.approx(posed.camera.position[2], abs=2e-3)


@pytest.mark.parametrize("up", [0.03, -0.03])
def test_a_pose_off_the_table_is_corrected_and_told(up, read):
    off = replace(EYE, position=EYE.position + [0.0, 0.0, up])
    seen = read(replace(CALIBRATION, poses=(pose_of(off),)))
    assert np.nanmedian(heights(seen)) == pytest.approx(0.0, abs=2e-3)
    np.testing.assert_allclose(seen.camera.position, EYE.position, atol=4e-3)
    assert any(f"the table lies {1e3 * up:+.0f} mm above z = 0" in note for note in seen.notes)


def test_a_tilted_pose_is_corrected(read):
    tilt = Rotation.from_rotvec([0.03, -0.02, 0.0]).as_matrix()
    off = replace(EYE, rotation=tilt @ EYE.rotation, position=tilt @ EYE.position)
    seen = read(replace(CALIBRATION, poses=(pose_of(off),)))
    points = seen.camera.points(seen.image.depth)
    on_table = points[np.abs(points[..., 2]) < 0.003]
    assert len(on_table) > 0.8 * np.isfinite(seen.image.depth).sum()
    np.testing.assert_allclose(seen.camera.rotation, EYE.rotation, atol=0.01)


def test_a_pose_that_fits_stays(read):
    camera = read(CALIBRATION).camera
    np.testing.assert_array_equal(camera.position, EYE.position)
    np.testing.assert_array_equal(camera.rotation, EYE.rotation)


@pytest.mark.parametrize("unit", [0.0, -1e-3, np.nan])
def test_a_unit_of_depth_is_positive(unit, read):
    with pytest.raises(ImageError, match="a unit of depth is positive"):
        read(CALIBRATION, depth_unit=unit)

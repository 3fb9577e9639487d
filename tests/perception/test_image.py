"""Images and their files."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from knotflow.perception import (
    SAMPLE,
    Appearance,
    Camera,
    CameraNoiseConfig,
    ImageError,
    RgbdImage,
    SimulatedCamera,
)
from knotflow.perception.camera.simulated import TAPE
from knotflow.simulation import RopeConfig


@pytest.fixture
def image(rng) -> RgbdImage:
    depth = rng.uniform(0.5, 2.0, (20, 30)).astype(np.float32)
    depth[3, 4] = np.nan
    return RgbdImage(rng.integers(0, 256, (20, 30, 3), np.uint8), depth)


def test_write_read_round_trip(image, tmp_path):
    for depth, tolerance in (("depth.npy", 0.0), ("depth.png", 0.5001e-3)):
        image.write(tmp_path / "rgb.png", tmp_path / depth)
        again = RgbdImage.read(tmp_path / "rgb.png", tmp_path / depth)
        np.testing.assert_array_equal(again.rgb, image.rgb)
        np.testing.assert_allclose(again.depth, image.depth, atol=tolerance, rtol=0)
        assert np.isnan(again.depth[3, 4]) and again.depth.dtype == np.float32


def test_integer_depth_is_millimetres(image, tmp_path):
    image.write(tmp_path / "rgb.png", tmp_path / "unused.npy")
    raw = np.full((20, 30), 1234, np.uint16)
    raw[0, 0] = 0
    np.save(tmp_path / "depth.npy", raw)
    depth = RgbdImage.read(tmp_path / "rgb.png", tmp_path / "depth.npy").depth
    assert depth[1, 1] == pytest.approx(1.234) and np.isnan(depth[0, 0])


def test_image_of_wrong_camera_size_raises(image, tmp_path):
    image.write(tmp_path / "rgb.png", tmp_path / "depth.png")
    with pytest.raises(ImageError, match="30x20 pixels, but the camera's are 320x240"):
        RgbdImage.read(tmp_path / "rgb.png", tmp_path / "depth.png", Camera.overhead())


def test_mismatched_colour_and_depth_raise(image):
    with pytest.raises(ImageError, match="colour is 30x20 pixels but depth 29x20"):
        RgbdImage(image.rgb, image.depth[:, 1:])


@pytest.mark.parametrize("unknown", [np.nan, 0.0, np.inf])
def test_image_without_depth_raises(unknown, image, tmp_path):
    image.write(tmp_path / "rgb.png", tmp_path / "unused.npy")
    np.save(tmp_path / "depth.npy", np.full((20, 30), unknown, np.float32))
    with pytest.raises(ImageError, match="depth.npy: no pixel has a depth"):
        RgbdImage.read(tmp_path / "rgb.png", tmp_path / "depth.npy")


def test_invalid_depth_raises(image, tmp_path):
    image.write(tmp_path / "rgb.png", tmp_path / "unused.npy")
    Image.fromarray(image.rgb[..., 0]).save(tmp_path / "eight-bit.png")
    np.save(tmp_path / "millimetres.npy", 1000.0 * image.depth)
    np.save(tmp_path / "cloud.npy", np.ones((20, 30, 3)))
    (tmp_path / "text.png").write_text("no image")
    for name, message in (
        ("eight-bit.png", "16-bit whole millimetres"),
        ("millimetres.npy", "must be in metres"),
        ("cloud.npy", r"the file has \(20, 30, 3\)"),
        ("text.png", "cannot be read as a depth image"),
        ("absent.npy", "cannot be read as a depth image"),
    ):
        with pytest.raises(ImageError, match=message) as caught:
            RgbdImage.read(tmp_path / "rgb.png", tmp_path / name)
        assert name in str(caught.value)


def test_shipped_sample_is_reproducible(tmp_path):
    points = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    look = Appearance(head=TAPE)
    camera = SimulatedCamera(Camera.overhead(), RopeConfig(), CameraNoiseConfig(), look)
    image = camera.capture(points, np.random.default_rng(0))
    image.write(tmp_path / "overhand.png", tmp_path / "overhand-depth.png")
    shipped = RgbdImage.read(
        SAMPLE / "overhand.png", SAMPLE / "overhand-depth.png", Camera.load(SAMPLE / "camera.yaml")
    )
    again = RgbdImage.read(tmp_path / "overhand.png", tmp_path / "overhand-depth.png")
    # Last digits differ between machines.
    assert (shipped.rgb == again.rgb).mean() > 0.99
    assert np.isclose(shipped.depth, again.depth, equal_nan=True).mean() > 0.99

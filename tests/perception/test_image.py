"""Images, their files, and the statistics of their noise."""

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
    add_noise,
)
from knotflow.perception.camera.image import (
    conventional_unit,
    read_colour,
    read_depth,
    shadow,
)
from knotflow.perception.camera.simulated import TAPE
from knotflow.simulation import RopeConfig


@pytest.fixture
def image(rng) -> RgbdImage:
    depth = rng.uniform(0.5, 2.0, (20, 30)).astype(np.float32)
    depth[3, 4] = np.nan
    return RgbdImage(rng.integers(0, 256, (20, 30, 3), np.uint8), depth)


def test_colours_and_depths_are_read(image, tmp_path):
    Image.fromarray(image.rgb).save(tmp_path / "rgb.png")
    np.testing.assert_array_equal(read_colour(tmp_path / "rgb.png"), image.rgb)
    np.save(tmp_path / "depth.npy", image.depth)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.npy"), image.depth)


def test_depth_in_thousands_is_millimetres(tmp_path):
    for kind in (np.uint16, np.float32):
        raw = np.full((20, 30), 1234, kind)
        raw[0, 0] = 0
        np.save(tmp_path / "depth.npy", raw)
        depth = read_depth(tmp_path / "depth.npy")
        assert conventional_unit(depth, "depth.npy") == 1e-3 and np.isnan(depth[0, 0])


def test_image_of_wrong_camera_size_raises(image):
    with pytest.raises(ImageError, match="30x20 pixels, but the camera's are 640x480"):
        image.check(Camera.overhead())


def test_mismatched_colour_and_depth_raise(image):
    with pytest.raises(ImageError, match="colour is 30x20 pixels but depth 29x20"):
        RgbdImage(image.rgb, image.depth[:, 1:])


@pytest.mark.parametrize("unknown", [np.nan, 0.0, np.inf])
def test_image_without_depth_raises(unknown, image, tmp_path):
    np.save(tmp_path / "depth.npy", np.full((20, 30), unknown, np.float32))
    with pytest.raises(ImageError, match="no pixel has a depth"):
        RgbdImage(image.rgb, read_depth(tmp_path / "depth.npy").astype(np.float32))


def test_grey_of_16_bits_is_no_white_picture(tmp_path):
    grey = np.linspace(0, 65535, 40, dtype=np.uint16).reshape(4, 10)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    found = read_colour(tmp_path / "grey.png")
    np.testing.assert_allclose(found, np.repeat(grey[..., None] / 257.0, 3, axis=2), atol=1.0)


@pytest.mark.parametrize("shape", [(0, 0), (0, 320)])
def test_depth_without_pixels_raises(shape, tmp_path):
    np.save(tmp_path / "depth.npy", np.zeros(shape))
    with pytest.raises(ImageError, match=r"depth.npy: depth is \(H, W\)"):
        read_depth(tmp_path / "depth.npy")


def test_invalid_depth_raises(image, tmp_path):
    Image.fromarray(image.rgb[..., 0]).save(tmp_path / "eight-bit.png")
    np.save(tmp_path / "quarters.npy", 4000.0 * image.depth)
    np.save(tmp_path / "cloud.npy", np.ones((20, 30, 3)))
    (tmp_path / "text.png").write_text("no image")
    for name, message in (
        ("eight-bit.png", "picture of depth in grey .8 bits."),
        ("quarters.npy", "say the unit"),
        ("cloud.npy", r"the file has \(20, 30, 3\)"),
        ("text.png", "cannot be read as a depth image"),
        ("absent.npy", "cannot be read as a depth image"),
    ):
        with pytest.raises(ImageError, match=message) as caught:
            conventional_unit(read_depth(tmp_path / name), tmp_path / name)
        assert name in str(caught.value)


def test_shipped_sample_is_reproducible():
    points = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    look = Appearance(head=TAPE)
    camera = SimulatedCamera(Camera.overhead(), RopeConfig(), CameraNoiseConfig(), look)
    again = camera.capture(points, np.random.default_rng(0))
    # Last digits differ between machines.
    assert (read_colour(SAMPLE / "overhand.png") == again.rgb).mean() > 0.99
    shipped = 1e-3 * read_depth(SAMPLE / "overhand-depth.png")
    assert np.isclose(shipped, again.depth, atol=0.5001e-3, equal_nan=True).mean() > 0.99


ONLY_DEPTH = dict(lateral_std=0, baseline=0, edge_loss=0, loss=0, colour_std=0, blur=0)


def flat(depth: float) -> RgbdImage:
    return RgbdImage(np.full((480, 640, 3), 100, np.uint8), np.full((480, 640), depth, np.float32))


@pytest.mark.parametrize("level", [1, 2])
def test_depth_noise_grows_with_the_square_of_the_distance(level, rng):
    noise = CameraNoiseConfig(level=level, depth_step=0, **ONLY_DEPTH)
    for depth in (0.6, 1.2):
        noisy = add_noise(flat(depth), Camera.overhead(), noise, rng).depth
        assert noisy.std() == pytest.approx(level * noise.depth_std * depth**2, rel=0.02)
        assert noisy.mean() == pytest.approx(depth, abs=1e-4)


def test_depth_comes_in_steps_that_grow_with_the_square_of_the_distance(rng):
    noise = CameraNoiseConfig(**ONLY_DEPTH)
    for depth in (0.6, 1.2):
        noisy = add_noise(flat(depth), Camera.overhead(), noise, rng).depth
        steps = np.diff(np.unique(noisy))
        assert len(steps) < 12
        np.testing.assert_allclose(steps, noise.depth_step * depth**2, rtol=0.05)


def test_more_depth_is_lost_at_edges(rng):
    image = flat(1.2)
    image.depth[:, 320:] = 1.0
    noise = CameraNoiseConfig(baseline=0)
    lost = np.isnan(add_noise(image, Camera.overhead(), noise, rng).depth)
    edge = np.zeros_like(lost)
    edge[:, 319:321] = True
    assert lost[edge].mean() == pytest.approx(noise.edge_loss, abs=0.08)
    assert lost[~edge].mean() == pytest.approx(noise.loss, rel=0.15)


def test_shadow():
    depth = np.full((4, 320), 1.2)
    depth[:, 150:200] = 0.8
    focal_baseline = 15.0
    dark = shadow(depth, focal_baseline)
    width = focal_baseline * (1 / 0.8 - 1 / 1.2)  # 6.25 pixels, left of what is nearer
    columns = np.flatnonzero(dark[2])
    assert columns.max() == 149 and columns.min() == 150 - round(width)
    sloping = np.tile(np.linspace(0.8, 1.6, 320), (4, 1))
    for flat_table in (sloping, sloping[:, ::-1]):
        assert not shadow(flat_table, focal_baseline).any()


def test_colour_noise_has_its_standard_deviation(rng):
    noise = CameraNoiseConfig(level=2, blur=0)
    rgb = add_noise(flat(1.2), Camera.overhead(), noise, rng).rgb.astype(float)
    assert rgb.std() == pytest.approx(2 * 255 * noise.colour_std, rel=0.02)
    assert rgb.mean() == pytest.approx(100, abs=0.1)


def test_level_zero_adds_no_noise(rng):
    image = RgbdImage(flat(1.0).rgb, flat(1.0).depth, time=2.5)
    perfect = add_noise(image, Camera.overhead(), CameraNoiseConfig(level=0), rng)
    np.testing.assert_array_equal(perfect.depth, image.depth)
    np.testing.assert_array_equal(perfect.rgb, image.rgb)
    assert add_noise(image, Camera.overhead(), CameraNoiseConfig(), rng).time == 2.5


def test_unknown_depth_stays_unknown(rng):
    image = flat(1.2)
    image.depth[:100] = np.nan
    noise = CameraNoiseConfig(lateral_std=0)
    assert np.isnan(add_noise(image, Camera.overhead(), noise, rng).depth[:100]).all()


def test_negative_noise_raises():
    with pytest.raises(ValueError, match="noise.depth_std must be 0 or more, got -1"):
        CameraNoiseConfig(depth_std=-1)


def test_binned_image_is_that_of_the_binned_camera(overhand, rng):
    camera = Camera.overhead()
    image = SimulatedCamera(camera, RopeConfig(radius=0.008)).view(overhand).image
    image.depth[:40, :40] = np.nan
    coarse = image.binned(2)
    small = SimulatedCamera(camera.binned(2), RopeConfig(radius=0.008)).view(overhand).image
    assert coarse.rgb.shape == (240, 320, 3) and coarse.depth.dtype == np.float32
    assert np.isnan(coarse.depth[:20, :20]).all() and np.isfinite(coarse.depth[20:]).all()
    # They differ at edges alone, where squares are half rope, half table.
    assert (np.abs(coarse.depth - small.depth)[20:] < 1e-3).mean() > 0.97
    assert (np.abs(coarse.rgb.astype(int) - small.rgb)[20:] < 3).mean() > 0.97
    assert image.binned(1) is image


@pytest.mark.parametrize("unknown", [0.0, -1.0, np.inf])
def test_depth_that_is_unknown_to_a_driver_is_nan(unknown, image):
    depth = image.depth.copy()
    depth[3, 4] = unknown
    np.testing.assert_array_equal(RgbdImage(image.rgb, depth).depth, image.depth)


def test_depth_of_an_image_is_in_metres(image):
    with pytest.raises(ImageError, match="depth is in metres, but most of the image is .* m away"):
        RgbdImage(image.rgb, 1000 * image.depth)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_grey_of_any_depth_of_bits_keeps_its_brightness(bits, tmp_path):
    grey = np.linspace(0, 2**bits - 1, 256).round().astype(np.uint16).reshape(16, 16)
    Image.fromarray(grey).save(tmp_path / "grey.png")
    expected = np.arange(256).reshape(16, 16)
    assert np.abs(read_colour(tmp_path / "grey.png")[..., 0] - expected).max() <= 1


def test_grey_that_is_unknown_is_black(tmp_path):
    grey = np.full((16, 16), 0.5, np.float32)
    grey[0, 0], grey[1, 1] = np.nan, 1.0
    Image.fromarray(grey).save(tmp_path / "grey.tiff")
    read = read_colour(tmp_path / "grey.tiff")[..., 0]
    assert read[0, 0] == 0 and read[1, 1] == 255 and read[2, 2] == 127

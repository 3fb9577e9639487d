"""The noise has the statistics it promises."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.perception import Camera, CameraNoiseConfig, RgbdImage, add_noise
from knotflow.perception.camera.image import shadow

ONLY_DEPTH = dict(lateral_std=0, baseline=0, edge_loss=0, loss=0, colour_std=0, blur=0)


def flat(depth: float) -> RgbdImage:
    return RgbdImage(np.full((240, 320, 3), 100, np.uint8), np.full((240, 320), depth, np.float32))


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
    image.depth[:, 160:] = 1.0
    noise = CameraNoiseConfig(baseline=0)
    lost = np.isnan(add_noise(image, Camera.overhead(), noise, rng).depth)
    edge = np.zeros_like(lost)
    edge[:, 159:161] = True
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

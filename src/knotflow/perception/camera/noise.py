"""A Kinect's noise on a perfect RGB-D image: errors and steps even in inverse depth, shadows of
the projector without depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera


@dataclass
class CameraNoiseConfig:
    """Noise of the simulated camera; every part grows with `level`."""

    level: float = 1.0
    """Factor on all that follows: 0 is a perfect image in fixed colours, 1 nominal, 2 poor."""
    depth_std: float = 1.425e-3
    """Standard deviation of inverse depth, 1/m: 2 mm at 1.2 m. Half a step (Khoshelham and
    Elberink, Accuracy and resolution of Kinect depth data, Sensors 12, 2012, Eq. 10)."""
    depth_step: float = 2.85e-3
    """Steps of inverse depth, 1/m: 4 mm at 1.2 m (same source)."""
    lateral_std: float = 0.5
    """Standard deviation of where a depth is read, pixels (Handa et al., ICRA 2014)."""
    baseline: float = 0.075
    """Distance of the projector to the camera's right, metres; it casts shadows without depth."""
    edge_jump: float = 0.03
    """Differences of depth between neighbouring pixels from here on are edges, metres."""
    edge_loss: float = 0.4
    """Probability that a pixel at an edge has no depth."""
    loss: float = 0.005
    """Probability that any other pixel has no depth."""
    colour_std: float = 0.015
    """Standard deviation of red, green and blue, share of the full scale."""
    blur: float = 0.5
    """Standard deviation of the colour image's blur, pixels."""
    contrast: float = 0.4
    """Least distance at level 1 between the colours of rope, table and head, Euclidean in sRGB."""
    light_tilt: float = 0.6
    """Largest tilt of the light at level 1, radians from the vertical."""
    white_balance: float = 0.03
    """Standard deviation of the light's strength in red, green and blue."""
    grain: float = 0.03
    """Largest amplitude of the waves in the table's brightness, share."""
    coloured_head: bool = True
    """Whether the rope's head is marked with tape."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0:
                raise ValueError(f"noise.{name} must be 0 or more, got {value}")


def add_noise(
    image: RgbdImage, camera: Camera, config: CameraNoiseConfig, rng: np.random.Generator
) -> RgbdImage:
    """The image as a Kinect would have taken it; the same for equal `rng`."""
    if config.level == 0:
        return image
    return RgbdImage(
        _noisy_colours(image.rgb, config, rng),
        _noisy_depth(image.depth, camera, config, rng),
        image.time,
    )


def _noisy_colours(
    rgb: NDArray[np.uint8], config: CameraNoiseConfig, rng: np.random.Generator
) -> NDArray[np.uint8]:
    from scipy import ndimage  # slow to import

    sigma = config.level * config.blur
    values = ndimage.gaussian_filter(rgb.astype(np.float32), (sigma, sigma, 0))
    std = 255.0 * config.level * config.colour_std
    values += std * rng.standard_normal(values.shape, dtype=np.float32)
    return np.rint(values).clip(0, 255).astype(np.uint8)


def _noisy_depth(
    true: NDArray[np.float32], camera: Camera, config: CameraNoiseConfig, rng: np.random.Generator
) -> NDArray[np.float32]:
    from scipy import ndimage

    level = config.level
    height, width = true.shape
    shift = np.rint(level * config.lateral_std * rng.standard_normal((2, height, width)))
    row = np.clip(np.arange(height)[:, None] + shift[0], 0, height - 1).astype(int)
    column = np.clip(np.arange(width) + shift[1], 0, width - 1).astype(int)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / true[row, column]
        inverse += level * config.depth_std * rng.standard_normal(true.shape)
        step = level * config.depth_step
        if step:
            inverse = step * np.rint(inverse / step)
        depth = np.where(inverse > 0, 1.0 / inverse, np.nan)
    neighbours = np.nan_to_num(true, nan=1e3)  # filters do not know NaN
    jump = ndimage.maximum_filter(neighbours, 3) - ndimage.minimum_filter(neighbours, 3)
    chance = np.where(jump > config.edge_jump, config.edge_loss, config.loss)
    lost = rng.random(true.shape) < level * chance
    depth[lost | shadow(true, camera.fx * level * config.baseline)] = np.nan
    return depth.astype(np.float32)


def shadow(depth: NDArray[np.float32], focal_baseline: float) -> NDArray[np.bool_]:
    """Where (H, W) something nearer hides a pixel of a depth (H, W), metres, from a projector to
    the camera's right: one to its right is further left in the projector's image. `focal_baseline`
    is focal length times distance of the projector, pixels times metres."""
    place = np.arange(depth.shape[1]) - focal_baseline / depth
    leftmost = np.full_like(place, np.inf)  # of the pixels to the right of each
    places = np.where(np.isnan(place), np.inf, place)[:, :0:-1]
    leftmost[:, :-1] = np.minimum.accumulate(places, axis=1)[:, ::-1]
    return place > leftmost - 0.5

"""RGB-D images: their files, and a Kinect's noise on perfect ones: errors and steps even in inverse
depth, shadows of the projector without depth."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.arrays import read_npy
from knotflow.perception.camera.pinhole import Camera

SAMPLE = Path(__file__).parents[1] / "data"
"""A sample: overhand.png, overhand-depth.png, camera.yaml, and the true rope, overhand.csv."""
FARTHEST = 20.0
"""Metres; a table is nearer."""
_USUAL = {1.0: (0.1, 10.0), 1e-3: (150.0, 3000.0)}
"""Median depths that are in a usual unit, metres, most likely; others are asked for."""
_MAX_PIXELS = 2**25  # of an image from a file
_ORIENTATION = 0x0112  # EXIF tag; 1 is upright
_PILLOW_ERRORS = (OSError, ValueError, SyntaxError, EOFError, MemoryError)


class Label(IntEnum):
    """What a pixel shows; `UNKNOWN` is no depth, or nothing that belongs here."""

    UNKNOWN = 0
    TABLE = 1
    ROPE = 2
    GRIPPER = 3


class ImageError(ValueError):
    """An image that cannot be read, or in which nothing could be seen."""


@dataclass(frozen=True, eq=False)
class RgbdImage:
    """Colour `rgb` (H, W, 3) uint8 and `depth` (H, W) float32 of the same pixels, metres along the
    optical axis; `time` in seconds. Depth that is unknown, 0 or not finite, becomes NaN.

    Raises:
        ImageError: another shape or type, colour and depth of different sizes, no depth at all, or
            most of it farther than `FARTHEST`.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    time: float = 0.0

    def __post_init__(self) -> None:
        if self.rgb.ndim != 3 or self.rgb.shape[2] != 3 or self.rgb.dtype != np.uint8:
            raise ImageError(f"rgb is (H, W, 3) uint8, got {self.rgb.shape} {self.rgb.dtype.name}")
        if self.depth.shape != self.rgb.shape[:2]:
            raise ImageError(
                f"colour is {_size(self.rgb)} pixels but depth {_size(self.depth)}; register depth "
                "to the colour image first"
            )
        if self.depth.dtype != np.float32:
            raise ImageError(f"depth is float32 in metres, got {self.depth.dtype.name}")
        known = np.isfinite(self.depth) & (self.depth > 0)
        if not known.any():
            raise ImageError("no pixel has a depth: all are NaN (or 0 in the file)")
        if (~known & ~np.isnan(self.depth)).any():
            object.__setattr__(self, "depth", np.where(known, self.depth, np.float32(np.nan)))
        if 2 * (self.depth > FARTHEST).sum() > known.sum():
            far = float(np.nanmedian(self.depth))
            raise ImageError(f"depth is in metres, but most of the image is {far:.4g} m away")

    def check(self, camera: Camera) -> None:
        """Raises `ImageError` where the image is not of this camera's size."""
        if self.depth.shape != (camera.height, camera.width):
            raise ImageError(
                f"the image is {_size(self.depth)} pixels, but the camera's are "
                f"{camera.width}x{camera.height}; give the calibration of this image size"
            )

    def binned(self, factor: int) -> RgbdImage:
        """The image of a camera `binned` by that factor: mean colours and median depths."""
        if factor == 1:
            return self
        from skimage.measure import block_reduce  # slow to import

        height, width = (size // factor * factor for size in self.depth.shape)
        rgb = block_reduce(self.rgb[:height, :width], (factor, factor, 1), np.mean)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # no depth in a square is NaN
            depth = block_reduce(self.depth[:height, :width], factor, np.nanmedian)
        return RgbdImage(rgb.round().astype(np.uint8), depth.astype(np.float32), self.time)


@contextmanager
def _opened(path: Path, kind: str) -> Iterator[Any]:
    """An image's file, opened by Pillow; raises `ImageError` where it cannot be read."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            yield image
    except ImageError:
        raise
    except (*_PILLOW_ERRORS, Image.DecompressionBombError) as error:
        raise ImageError(f"{path}: cannot be read as a {kind} image: {error}") from error


def _read_pixels(path: Path, kind: str, mode: str | None = None, upright: bool = False) -> NDArray:
    """The pixels of an image's file, in one of Pillow's modes if one is given."""
    from PIL import Image, ImageOps

    with _opened(path, kind) as image:
        if image.width * image.height > _MAX_PIXELS:
            raise ImageError(
                f"{path}: {image.width}x{image.height} pixels are too many for a {kind} image; "
                f"give it with {_MAX_PIXELS / 1e6:.0f} million at most"
            )
        turned = ImageOps.exif_transpose(image) if upright else image
        if mode == "RGB" and turned.mode.startswith(("I", "F")):  # Pillow cuts them off at 255
            values = np.asarray(turned, np.float64)
            values = np.nan_to_num(values, posinf=0.0, neginf=0.0)
            full = max(values.max(), 1.0)
            if turned.mode.startswith("I"):  # of 10, 12, 14 or 16 bits
                full = 2.0 ** max(np.ceil(np.log2(full + 1.0)), 8.0) - 1.0
            turned = Image.fromarray((255.0 * values / full).clip(0, 255).astype(np.uint8))
        return np.asarray(turned.convert(mode) if mode else turned)


def read_colour(path: Path, upright: bool = False) -> NDArray[np.uint8]:
    """The colours (H, W, 3) of an image's file, turned as the file says (EXIF) if `upright`; raises
    `ImageError`."""
    return _read_pixels(path, "colour", "RGB", upright)


def is_turned(path: Path) -> bool:
    """Whether an image's file says that it is to be shown turned (EXIF); raises `ImageError`."""
    with _opened(path, "colour") as image:
        return int(image.getexif().get(_ORIENTATION, 1)) != 1


def read_depth(path: Path) -> NDArray[np.float64]:
    """The depths (H, W) of a file, in its unit, NaN where unknown; raises `ImageError`."""
    if path.suffix.lower() == ".npy":
        try:
            raw = read_npy(path)
        except (OSError, ValueError) as error:
            raise ImageError(f"{path}: cannot be read as a depth image: {error}") from error
    else:
        raw = _read_pixels(path, "depth")
    if raw.dtype == np.uint8 and raw.ndim in (2, 3):
        raise ImageError(
            f"{path}: is a picture of depth in {'colours' if raw.ndim == 3 else 'grey'} (8 bits), "
            "which tells no distances; give the depth as the camera measures it, one channel of 16 "
            "bits or NPY (RealSense: before the colorizer; ROS: topics with encoding 16UC1 or "
            "32FC1)"
        )
    if raw.ndim != 2 or not raw.size or raw.dtype.kind not in "uif":
        raise ImageError(
            f"{path}: depth is (H, W), whole numbers of 16 bits or floats; the file has "
            f"{raw.shape} {raw.dtype.name}"
        )
    raw = raw.astype(np.float64)
    raw[~np.isfinite(raw) | (raw <= 0)] = np.nan
    return raw


def interpolated(
    image: NDArray, pixels: NDArray, order: int = 1, outside: float | None = None
) -> NDArray:
    """Values (..., C) of an image (H, W, C), or (...) of one (H, W), at pixels u, v (..., 2).
    Beyond its border are those at it, or `outside`."""
    from scipy import ndimage  # slow to import

    mode, at = "nearest" if outside is None else "constant", np.moveaxis(pixels[..., ::-1], -1, 0)
    layers = [
        ndimage.map_coordinates(one, at, order=order, mode=mode, cval=outside or 0.0)
        for one in np.moveaxis(np.atleast_3d(image), 2, 0)
    ]
    return np.stack(layers, axis=-1).reshape(*pixels.shape[:-1], *image.shape[2:])


def conventional_unit(raw: NDArray, path: Path | str) -> float:
    """The usual unit, metres, in which depths (H, W) are those of a table.

    Raises:
        ImageError: they may be in another one.
    """
    median = float(np.nanmedian(raw))
    for unit, (low, high) in _USUAL.items():
        if low <= median <= high:
            return unit
    raise ImageError(
        f"{path}: the median depth is {median:.4g}, which is no table's in metres or millimetres: "
        "say the unit with --depth-unit, as in 0.25mm, or as depth_scale in the camera file"
    )


def _size(pixels: NDArray) -> str:
    return f"{pixels.shape[1]}x{pixels.shape[0]}"


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
    from scipy import ndimage  # slow to import

    level, true = config.level, image.depth
    if level == 0:
        return image
    sigma = level * config.blur
    rgb = ndimage.gaussian_filter(image.rgb.astype(np.float32), (sigma, sigma, 0))
    rgb += 255.0 * level * config.colour_std * rng.standard_normal(rgb.shape, dtype=np.float32)

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
    colours = np.rint(rgb).clip(0, 255).astype(np.uint8)
    return RgbdImage(colours, depth.astype(np.float32), image.time)


def shadow(depth: NDArray[np.float32], focal_baseline: float) -> NDArray[np.bool_]:
    """Where (H, W) something nearer hides a pixel of a depth (H, W), metres, from a projector to
    the camera's right; `focal_baseline` is focal length times its distance, pixels times metres."""
    place = np.arange(depth.shape[1]) - focal_baseline / depth  # in the projector's image
    leftmost = np.full_like(place, np.inf)  # of the pixels to the right of each
    places = np.where(np.isnan(place), np.inf, place)[:, :0:-1]
    leftmost[:, :-1] = np.minimum.accumulate(places, axis=1)[:, ::-1]
    return place > leftmost - 0.5

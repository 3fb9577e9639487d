"""RGB-D images, of a real camera's files or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.arrays import read_npy
from knotflow.perception.camera.pinhole import Camera

SAMPLE = Path(__file__).parents[1] / "data"
"""A sample: overhand.png, overhand-depth.png, camera.yaml, and the true rope, overhand.csv."""
MAX_DEPTH = 20.0
"""A median depth beyond this, metres, is in another unit."""
MAX_PIXELS = 2**25
"""Of an image from a file."""
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
    optical axis, NaN where unknown; `time` in seconds.

    Raises:
        ImageError: another shape or type, colour and depth of different sizes, or no depth at all.
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
        if not np.isfinite(self.depth).any():
            raise ImageError("no pixel has a depth: all are NaN (or 0 in the file)")

    def check(self, camera: Camera) -> None:
        """Raises `ImageError` where the image is not of this camera's size."""
        if self.depth.shape != (camera.height, camera.width):
            raise ImageError(
                f"the image is {_size(self.depth)} pixels, but the camera's are "
                f"{camera.width}x{camera.height}; give the calibration of this image size"
            )

    @classmethod
    def read(cls, rgb: Path | str, depth: Path | str, camera: Camera | None = None) -> RgbdImage:
        """The image of two files, of the camera's size if one is given.

        Args:
            rgb: PNG (or another format that Pillow reads).
            depth: PNG of 16 bits, or NPY. Whole numbers are millimetres, floats are metres; 0 and
                what is not finite is unknown.

        Raises:
            ImageError: naming the file and what is wrong with it.
        """
        colour = _read_pixels(Path(rgb), "colour", "RGB")
        distances = _read_depth(Path(depth))
        try:
            image = cls(colour, distances)
            if camera is not None:
                image.check(camera)
        except ImageError as error:
            raise ImageError(f"{rgb}, {depth}: {error}") from error
        return image

    def write(self, rgb: Path | str, depth: Path | str) -> None:
        """Write the files that `read` reads; depth as 16-bit PNG (whole millimetres) or NPY."""
        from PIL import Image

        Image.fromarray(self.rgb).save(rgb)
        if Path(depth).suffix.lower() == ".npy":
            np.save(depth, self.depth)
            return
        millimetres = np.round(np.nan_to_num(self.depth) * 1000).clip(0, 2**16 - 1)
        Image.fromarray(millimetres.astype(np.uint16)).save(depth)


def _read_pixels(path: Path, kind: str, mode: str | None = None) -> NDArray:
    """The pixels of an image's file, in one of Pillow's modes if one is given."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            if image.width * image.height > MAX_PIXELS:
                raise ImageError(
                    f"{path}: {image.width}x{image.height} pixels are too many for a {kind} image; "
                    f"give it with {MAX_PIXELS / 1e6:.0f} million at most"
                )
            return np.asarray(image.convert(mode) if mode else image)
    except ImageError:
        raise
    except (*_PILLOW_ERRORS, Image.DecompressionBombError) as error:
        raise ImageError(f"{path}: cannot be read as a {kind} image: {error}") from error


def _read_depth(path: Path) -> NDArray[np.float32]:
    """The depths (H, W) of a file, metres, NaN where unknown."""
    if path.suffix.lower() == ".npy":
        try:
            raw = read_npy(path)
        except (OSError, ValueError) as error:
            raise ImageError(f"{path}: cannot be read as a depth image: {error}") from error
    else:
        raw = _read_pixels(path, "depth")
    if raw.ndim != 2 or raw.dtype.kind not in "uif" or raw.dtype == np.uint8:
        raise ImageError(
            f"{path}: depth is (H, W), 16-bit whole millimetres or float metres; the file has "
            f"{raw.shape} {raw.dtype.name}"
        )
    metres = raw.astype(np.float32) * (1.0 if raw.dtype.kind == "f" else 1e-3)
    metres[~np.isfinite(metres) | (metres <= 0)] = np.nan
    known = metres[np.isfinite(metres)]
    if known.size and np.median(known) > MAX_DEPTH:
        raise ImageError(
            f"{path}: the median depth is {np.median(known):.0f} m; depth as floats must be in "
            "metres, in millimetres they must be whole numbers (uint16)"
        )
    return metres.astype(np.float32)


def _size(pixels: NDArray) -> str:
    return f"{pixels.shape[1]}x{pixels.shape[0]}"

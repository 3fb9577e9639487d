"""An RGB-D image from ROS messages: sensor_msgs Image, twice, and CameraInfo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.calibration import Calibration
from knotflow.perception.camera.image import ImageError, RgbdImage

ENCODINGS = {"rgb8": ("u1", 3), "bgr8": ("u1", 3), "16UC1": ("u2", 1), "32FC1": ("f4", 1)}
"""Type and number of the channels of images that can be read."""


def stamp(message: Any) -> float:
    """Seconds at which a message was stamped."""
    time = message.header.stamp
    return float(time.sec) + 1e-9 * float(time.nanosec)


def read_messages(colour: Any, depth: Any, info: Any, rectified: bool = False) -> RgbdImage:
    """The image, without the lens distortion in `info` unless its topics are `rectified`.

    Raises:
        ImageError: an encoding that is not in `ENCODINGS`, or depth of another size.
        CameraError: a distortion model that is not known.
    """
    rgb, metres = decode(colour), decode(depth)
    calibration = Calibration.of(info, "CameraInfo")
    if calibration.distortion.size and not rectified:
        calibration = calibration.scaled(colour.width, colour.height)
        rgb = calibration.undistorted(rgb)
        metres = calibration.undistorted(metres, nearest=True)
    return RgbdImage(rgb, metres, min(stamp(colour), stamp(depth)))


def decode(message: Any) -> NDArray:
    """Pixels: colour (H, W, 3) uint8, or depth (H, W) float32, metres, NaN where unknown.

    Raises:
        ImageError: an encoding that is not in `ENCODINGS`.
    """
    height, width, encoding = message.height, message.width, message.encoding
    if encoding not in ENCODINGS:
        raise ImageError(
            f"an image has the encoding {encoding!r}; those of {', '.join(ENCODINGS)} can be read"
        )
    kind, channels = ENCODINGS[encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(message.data, np.uint8).reshape(height, message.step)  # may be padded
    used = np.ascontiguousarray(rows[:, : width * channels * dtype.itemsize])
    pixels = used.view(dtype).reshape(height, width, channels)
    if channels == 3:
        return np.ascontiguousarray(pixels[..., ::-1] if encoding == "bgr8" else pixels)
    depth = pixels[..., 0].astype(np.float32) * np.float32(1e-3 if encoding == "16UC1" else 1.0)
    depth[~np.isfinite(depth) | (depth <= 0.0)] = np.nan
    return depth

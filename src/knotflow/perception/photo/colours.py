"""Colours that a user gives: of the rope, and of its head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from skimage.color import rgb2lab

from knotflow.perception.camera.image import ImageError
from knotflow.topology.polyline import arc_lengths, interpolate

Colour = tuple[int, int, int]
"""Red, green, blue, 0..255."""

_END = 0.08  # share of the rope's length, at which its ends are compared
_WEIGHTS = np.array([0.3, 1.0, 1.0])  # of lightness beside hue and chroma, in CIELAB
_LEAST = 0.1  # of the way from the rope's colour to the head's, that a mark goes
_CLEAR = 0.75  # of the share of a mark, that the other end and the rope between have at most
_ALIKE = 10.0  # distance of a colour from the rope's, which tells nothing
NO_HEAD = "neither end has the colour of the head"


@dataclass(frozen=True)
class Colours:
    """What is known of a rope's colours; None where nothing is."""

    rope: Colour | None = None
    head: Colour | None = None

    @classmethod
    def parse(cls, rope: str | None = None, head: str | None = None) -> Colours:
        """From names such as red, or #rrggbb; without a text nothing is known.

        Raises:
            ImageError: no colour.
        """
        return cls(_parse(rope), _parse(head))


def _parse(text: str | None) -> Colour | None:
    from PIL import ImageColor

    if not text:
        return None
    try:
        colour = ImageColor.getrgb(text)[:3]
        if max(colour) <= 255:
            return cast("Colour", colour)
    except ValueError:
        pass
    raise ImageError(f"{text!r} is no colour: give a name such as red, or #rrggbb")


def end_of_colour(rgb: NDArray[np.uint8], pixels: NDArray, colour: Colour) -> int | None:
    """Which end of a line (N, 2) of pixels in an image (H, W, 3) has a colour: 0 or -1.

    None where no pixel of an end is clearly further on the way from the rope's colour to that one
    than the other end and the rope between them.
    """
    line = np.nan_to_num(pixels)
    along = arc_lengths(line)
    at = np.arange(0.0, max(along[-1], 1.0))
    last = np.array(rgb.shape[1::-1]) - 1
    even = interpolate(at, along, line)
    u, v = np.clip(np.round(even), 0, last).astype(int).T
    seen = rgb2lab(rgb[v, u][None])[0] * _WEIGHTS
    plain = np.median(seen, axis=0)
    way = rgb2lab(np.array(colour, np.uint8)[None, None])[0, 0] * _WEIGHTS - plain
    if np.linalg.norm(way) < _ALIKE:
        return None
    shares = median_filter((seen - plain) @ way / (way @ way), 3, mode="mirror")
    count = max(1, round(_END * len(shares)))
    first, other = (float(np.max(some)) for some in (shares[:count], shares[-count:]))
    between = float(np.quantile(shares[count:-count], 0.99)) if len(shares) > 2 * count else 0.0
    if max(first, other) * _CLEAR < max(min(first, other), between, _CLEAR * _LEAST):
        return None
    return 0 if first > other else -1

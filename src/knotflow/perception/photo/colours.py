"""Colours that a user gives: of the rope, and of its head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from skimage.color import rgb2lab

from knotflow.perception.camera.image import ImageError

Colour = tuple[int, int, int]
"""Red, green, blue, 0..255."""

_END = 0.06  # share of the rope's length, at which its ends are compared
_CLEAR = 0.75  # times as far from the colour as the other end and the rope, an end is the head
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
    """Which end of a line (N, 2) of pixels in an image (H, W, 3) has a colour: 0 or -1; None where
    neither is clearly nearer to it than the other and than the rope between them."""
    count = max(1, round(_END * len(pixels)))
    last = np.array(rgb.shape[1::-1]) - 1
    u, v = np.clip(np.round(np.nan_to_num(pixels)), 0, last).astype(int).T
    wanted = rgb2lab(np.array(colour, np.uint8)[None, None])[0, 0]
    off = np.linalg.norm(rgb2lab(rgb[v, u][None])[0] - wanted, axis=1)
    first, other = (float(np.min(some)) for some in (off[:count], off[-count:]))
    between = float(np.median(off[count:-count])) if len(off) > 2 * count else np.inf
    if min(first, other) > _CLEAR * min(max(first, other), between):
        return None
    return 0 if first < other else -1

"""Where along a shape the rope's coloured head is seen, which tells head from tail."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.image import RgbdImage

_END = 2  # vertices that have the head's colour


def contrast(
    shape: NDArray, mask: NDArray[np.bool_], image: RgbdImage, camera: Camera
) -> NDArray[np.float64]:
    """(V,) distance in RGB (0..1) of the colour at each vertex of a shape (V, 3) from the rope's,
    where the `mask` (H, W) shows rope; 0 where it shows none nearest to the vertex."""
    column, row, _ = camera.project(shape).T
    pixels = np.argwhere(mask)
    apart = np.hypot(pixels[:, :1] - row, pixels[:, 1:] - column)  # (P, V)
    nearest = apart.argmin(axis=1)
    colours = image.rgb[mask] / 255.0
    plain = np.median(colours, axis=0)
    found = np.zeros(len(shape))
    for vertex in np.unique(nearest):
        found[vertex] = np.linalg.norm(np.median(colours[nearest == vertex], axis=0) - plain)
    return found


def head_end(contrasts: NDArray, least: float) -> int | None:
    """0 where the first vertices are of another colour than the rope, -1 where the last are; None
    where neither stand out by `least`, and twice as much as the other."""
    first, last = contrasts[:_END].max(), contrasts[-_END:].max()
    if max(first, last) <= max(least, 2 * min(first, last)):
        return None
    return 0 if first > last else -1


def is_away_from_ends(contrasts: NDArray, least: float) -> bool:
    """Whether a head is seen, but along the shape, where it cannot be."""
    ends = max(contrasts[:_END].max(), contrasts[-_END:].max())
    along = contrasts[_END:-_END].max(initial=0.0)
    return bool(along > max(least, 2 * ends))

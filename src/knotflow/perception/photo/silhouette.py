"""The silhouette of a rope of unknown colour and width: what stands out from the table and is long
and evenly wide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.color import rgb2lab
from skimage.filters import threshold_otsu
from skimage.measure import block_reduce
from skimage.morphology import skeletonize

from knotflow.perception.camera.image import ImageError, interpolated

_GRID = 64  # squares along the image's shorter side, whose median is a sample of the table
_WINDOW = 25  # squares: the rope covers less than half of so large a part of the table
_LEAST_CONTRAST = 9.0  # CIELAB: rope against table
_NOISE = 6.0  # median deviations of the table
_DENOISE = 0.6  # pixels
_LIKE_GIVEN = 40.0  # CIELAB distance within which a pixel has a given colour
_LEAST_WIDTH = 2.5  # pixels
_LEAST_LENGTH = 20.0  # widths: a shorter thing is no rope
_EVEN, _LEAST_EVEN = 0.3, 0.75  # share of the width by which most of a rope's widths differ at most
_MOST_BRANCHES = 0.45  # branching pixels a width of length: ropes have few, texture many


@dataclass(frozen=True, eq=False)
class Silhouette:
    """A rope's silhouette.

    Attributes:
        coverage: (H, W) share of each pixel of the image that the rope covers, 0..1.
        width: of the rope, pixels.
        length: of its skeleton, pixels.
        others: skeleton lengths of other ropes in view, pixels.
    """

    coverage: NDArray[np.float32]
    width: float
    length: float
    others: tuple[float, ...] = ()


class _Part(NamedTuple):
    """A connected part of a mask that may be a rope: its width and skeleton length, pixels."""

    label: int
    width: float
    length: float
    even: float


def find_silhouette(
    rgb: NDArray[np.uint8], colour: tuple[int, int, int] | None = None
) -> Silhouette:
    """The longest rope in an image (H, W, 3), of a `colour` (red, green, blue) if given.

    Raises:
        ImageError: nothing in it is long and evenly wide.
    """
    lab = rgb2lab(rgb).astype(np.float32)
    table = _table(lab)
    contrast = np.linalg.norm(ndimage.gaussian_filter(lab - table, (_DENOISE, _DENOISE, 0)), axis=2)
    if colour is not None:
        given = rgb2lab(np.array(colour, np.uint8)[None, None]).astype(np.float32)
        off = np.linalg.norm(lab - given, axis=2)
        contrast = np.where(off < _LIKE_GIVEN, contrast, 0.0)
    found = []
    for threshold in _thresholds(contrast):
        parts, count = ndimage.label(contrast > threshold, np.ones((3, 3)))
        if ropes := _ropes(parts, count):
            found.append((ropes[0].length / ropes[0].width * ropes[0].even, parts, ropes))
    if not found:
        raise ImageError("no rope is seen: nothing that differs from the table is long and narrow")
    _, parts, (rope, *others) = max(found, key=lambda one: one[0])
    return Silhouette(
        _coverage(lab, table, parts == rope.label, rope.width),
        rope.width,
        rope.length,
        tuple(one.length for one in others),
    )


def _table(lab: NDArray[np.float32]) -> NDArray[np.float32]:
    """The table's colour (H, W, 3) at each pixel: a wide running median."""
    height, width = lab.shape[:2]
    step = max(1, min(height, width) // _GRID)
    whole = lab[: height // step * step, : width // step * step]
    thin = block_reduce(whole, (step, step, 1), np.median)
    smooth = ndimage.median_filter(thin, (_WINDOW, _WINDOW, 1), mode="nearest")
    smooth = ndimage.gaussian_filter(smooth, (2, 2, 0), mode="nearest")
    at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return interpolated(smooth, (at + 0.5) / step - 0.5)


def _thresholds(contrast: NDArray[np.float32]) -> list[float]:
    """Contrasts from which a pixel may be rope, rising."""
    least = max(_LEAST_CONTRAST, _NOISE * float(np.median(contrast)))
    above = contrast[contrast > least]
    if not len(above):
        return []
    found = [least, threshold_otsu(contrast), threshold_otsu(above), 0.5 * np.median(above)]
    return sorted({max(least, float(one)) for one in found})


def _ropes(parts: NDArray[np.int32], count: int) -> list[_Part]:
    """The parts (H, W) that are long, evenly wide and have an end, longest first."""
    found = []
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    for label, box in enumerate(ndimage.find_objects(parts), 1):
        least = _LEAST_LENGTH * _LEAST_WIDTH**2
        if sizes[label] < least or np.hypot(*(axis.stop - axis.start for axis in box)) < 10:
            continue
        mask = np.pad(parts[box] == label, 1)
        bones = skeletonize(mask)
        inside = ndimage.distance_transform_edt(mask)[bones]
        length = 1.1 * float(bones.sum())  # pixels of a skeleton are 1 to 1.41 apart
        width = float(sizes[label]) / length
        half = float(np.median(inside))
        even = float((np.abs(inside - half) <= _EVEN * half + 0.5).mean())
        near = ndimage.convolve(bones.astype(int), np.ones((3, 3), int), mode="constant")
        branches = float((bones & (near > 3)).sum()) / (length / width)
        ends = int((bones & (near == 2)).sum())
        if (
            ends
            and width >= _LEAST_WIDTH
            and length >= _LEAST_LENGTH * width
            and even >= _LEAST_EVEN
            and branches <= _MOST_BRANCHES
        ):
            found.append(_Part(label, width, length, even))
    return sorted(found, key=lambda one: -one.length)


def _coverage(
    lab: NDArray[np.float32], table: NDArray[np.float32], mask: NDArray[np.bool_], width: float
) -> NDArray[np.float32]:
    """Share (H, W) of each pixel that the rope covers: how far its colour is from the table's
    toward the rope's around there."""
    core = ndimage.distance_transform_edt(mask) > 0.25 * width
    weight = ndimage.gaussian_filter(core.astype(np.float32), 3 * width) + 1e-9
    around = np.where(core[..., None], lab, np.float32(0))
    rope = ndimage.gaussian_filter(around, (3 * width, 3 * width, 0)) / weight[..., None]
    line = rope - table
    share = np.linalg.norm(lab - table, axis=2) / np.maximum(np.linalg.norm(line, axis=2), 1e-6)
    near = ndimage.binary_dilation(mask, iterations=max(1, round(0.3 * width)))
    return np.where(near, share, 0.0).clip(0, 1).astype(np.float32)

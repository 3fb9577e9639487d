"""From a path in an image to a rope in space: heights from the depth image, over and under."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.fitting import project_lengths
from knotflow.perception.tracing import Trace
from knotflow.simulation import RopeConfig
from knotflow.topology.polyline import DegenerateCurveError, planar_crossings

Floats = NDArray[np.float64]

_LITTLE, _DRAWN_BACK = 0.01, 3  # share of a link that an end is drawn back, and how often
_BESIDE = (1.2, 3.0)  # radii from a crossing, between which a strand's height is its own


def lift(
    path: Trace, mask: NDArray[np.bool_], depth: NDArray, camera: Camera, rope: RopeConfig
) -> Floats:
    """The rope (V, 3), metres, world frame, along a path in the image.

    Args:
        path: along the rope.
        mask: (H, W), where the rope is seen.
        depth: (H, W) metres along the optical axis, NaN where unknown.
        camera: that took the image.
        rope: its length, radius and number of links.
    """
    axis = _axis(path.pixels, mask, depth, camera, rope.radius)  # (N, 3)
    along = _reached(axis[:, :2])
    even = np.linspace(0.0, along[-1], rope.num_vertices)
    width = max(1, round(2 * rope.radius / (along[-1] / len(along))))  # path steps in a width
    smooth = _running_mean(axis, width)
    shape = np.stack([np.interp(even, along, smooth[:, k]) for k in range(3)], axis=1)
    shape[:, 2] = np.maximum(shape[:, 2], rope.radius)
    shape = _part_strands(shape, rope)
    return project_lengths(shape, rope.link_length)


def _axis(
    pixels: Floats, mask: NDArray[np.bool_], depth: NDArray, camera: Camera, radius: float
) -> Floats:
    """Points (N, 3) of the rope's axis at pixels (N, 2); on the table without a known depth."""
    column = np.clip(np.round(pixels[:, 0]).astype(int), 0, camera.width - 1)
    row = np.clip(np.round(pixels[:, 1]).astype(int), 0, camera.height - 1)
    known = np.where(mask, depth, np.nan)
    padded = np.pad(known, 1, constant_values=np.nan)
    shifts = [padded[row + 1 + i, column + 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    around = np.stack(shifts)  # (9, N)
    far = camera.unproject(pixels, np.ones(len(pixels))) - camera.position
    on_table = (radius - camera.position[2]) / np.minimum(far[:, 2], -1e-9)
    # The nearest pixels of nine are on the rope's ridge, the farther ones on its flanks.
    surface = np.where(
        np.isnan(around).all(axis=0), on_table, _known_quantile(around, 0.3) + radius
    )
    return camera.unproject(pixels, np.minimum(surface, on_table))


def _known_quantile(values: Floats, share: float) -> Floats:
    """Quantile (N,) over those of values (M, N) that are not NaN; as `numpy.nanquantile`, which
    goes through N one by one."""
    rising = np.sort(values, axis=0)  # NaN comes last
    last = (~np.isnan(values)).sum(axis=0) - 1
    at = share * np.maximum(last, 0)
    low = at.astype(int)
    columns = np.arange(values.shape[1])
    lower, upper = rising[low, columns], rising[np.minimum(low + 1, np.maximum(last, 0)), columns]
    return lower + (at - low) * (upper - lower)


def _part_strands(shape: Floats, rope: RopeConfig) -> Floats:
    """Lays one strand of each crossing over the other.

    At a crossing the image shows the upper strand only. Beside it, the upper strand is still
    above where the lower one is back on its own height.
    """
    along = _reached(shape[:, :2])
    lifted = shape.copy()
    for places in np.interp(passages(shape), np.arange(len(shape)), along):
        beside = [
            [place + side * reach * rope.radius for side in (-1, 1) for reach in _BESIDE]
            for place in places
        ]
        heights = [float(np.interp(one, along, shape[:, 2]).mean()) for one in beside]
        over, under = (0, 1) if heights[0] > heights[1] else (1, 0)
        lower = min(heights[under], 2 * rope.radius)
        for strand, height in ((under, lower), (over, lower + 2.2 * rope.radius)):
            near = np.abs(along - places[strand]) < _BESIDE[1] * rope.radius
            lifted[near, 2] = height
    return lifted


def passages(shape: NDArray) -> Floats:
    """(C, 2) where a shape (V, 3) crosses itself, 0..V-1, the earlier passage first.

    An end that only touches a strand is no crossing: a guess may well end there.
    """
    curve = np.array(shape[:, :2], np.float64)
    for _ in range(_DRAWN_BACK):
        try:
            met = planar_crossings(curve)
        except DegenerateCurveError:
            curve[0] += _LITTLE * (curve[1] - curve[0])
            curve[-1] += _LITTLE * (curve[-2] - curve[-1])
        else:
            return np.stack([met.first + met.first_along, met.second + met.second_along], axis=1)
    return np.empty((0, 2))  # it ends along a strand


def _reached(curve: Floats) -> Floats:
    """(N,) length of a curve (N, D) up to each of its points."""
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1) + 1e-12)]


def _running_mean(curve: Floats, width: int) -> Floats:
    """A curve (N, 3) averaged over `width` points; its ends stay where they are."""
    from scipy.ndimage import uniform_filter1d

    ends = 2 * curve[0] - curve[width:0:-1], 2 * curve[-1] - curve[-2 : -width - 2 : -1]
    padded = np.concatenate([ends[0], curve, ends[1]])
    return uniform_filter1d(padded, 2 * (width // 2) + 1, axis=0)[len(ends[0]) :][: len(curve)]

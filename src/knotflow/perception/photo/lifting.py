"""A first guess of a rope in an RGB-D image from its colours, which need not be known: the table is
looked at from above, as in a photograph."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from knotflow.perception.camera.image import ImageError, RgbdImage, interpolated
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.crossings import crossing_fractions, exchange_heights
from knotflow.perception.estimation.skeleton import lift
from knotflow.perception.photo.colours import Colour, Colours
from knotflow.perception.photo.estimate import estimate_photo
from knotflow.simulation import RopeConfig
from knotflow.topology.polyline import Floats

_WIDTH = 6.0  # of the rope from above, pixels
_AROUND = 12.0  # widths of table around what is taken for rope
_MOST_PIXELS = 1200  # of the view from above, along either side
_STANDS = 0.06  # metres above or below the table, from where on it is something else


def shape_by_colour(
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    mask: NDArray,
    height: NDArray,
    colour: Colour | None = None,
) -> tuple[Floats, float] | None:
    """The rope (V, 3), metres, world frame, from either end, and how long it looks, metres; None
    where colours do not show it without doubt, but for which strand is on top.

    It lies about the `mask` (H, W) and is no higher above the table (`height` (H, W), metres) than
    a rope; its `colour` is asked for if it is known.
    """
    table = ~(np.abs(height) > _STANDS)  # also where depth is missing
    width = 2 * rope.radius
    around = camera.on_plane(mask & table, rope.radius)
    if not len(around):
        return None
    low, high = around.min(0) - _AROUND * width, around.max(0) + _AROUND * width
    step = max(width / _WIDTH, float((high - low).max()) / _MOST_PIXELS)
    columns, rows = (np.arange(a, b, step) for a, b in zip(low, high, strict=True))
    x, y = np.meshgrid(columns, rows[::-1])
    pixels = camera.project(np.stack([x, y, np.full_like(x, rope.radius)], -1))[..., :2]
    places = np.nan_to_num(pixels, nan=-9.0)
    seen = interpolated(table.astype(float), places, outside=0.0) > 0.5
    seen &= np.isfinite(pixels).all(-1)
    if not seen.any():
        return None
    above = interpolated(image.rgb.astype(float), places)
    nearest = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
    try:
        found = estimate_photo(above[tuple(nearest)].round().astype(np.uint8), Colours(colour))
    except ImageError:
        return None
    u, v = found.pixels.T
    if any(not doubt.startswith("crossing") for doubt in found.doubts) or not (
        ndimage.map_coordinates(seen.astype(float), [v, u], order=0).all()
    ):
        return None
    on_table = np.stack([low[0] + u * step, rows[-1] - v * step, np.full_like(u, rope.radius)], -1)
    path = camera.project(on_table)[:, :2]
    shape = lift(path, table, image.depth, camera, rope)
    met = crossing_fractions(shape)
    if len(met) != len(found.crossings):
        return None
    for place, one in zip(met, found.crossings, strict=True):
        first, second = np.interp(place, np.linspace(0.0, 1.0, len(shape)), shape[:, 2])
        if (first > second) != one.first_over:
            shape = exchange_heights(shape, *place, rope)
    return shape, found.length * step

"""A first guess of a rope in an RGB-D image from its colours, which need not be known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import ImageError, RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.crossings import crossing_fractions, exchange_heights
from knotflow.perception.estimation.skeleton import lift
from knotflow.perception.photo.estimate import estimate_photo
from knotflow.simulation import RopeConfig

Floats = NDArray[np.float64]


def shape_by_colour(image: RgbdImage, camera: Camera, rope: RopeConfig) -> Floats | None:
    """The rope (V, 3), metres, world frame, from either end; None where colours do not show it
    without doubt, but for which strand is on top."""
    try:
        found = estimate_photo(image.rgb)
    except ImageError:
        return None
    if any(not doubt.startswith("crossing") for doubt in found.doubts):
        return None
    shape = lift(found.pixels, np.isfinite(image.depth), image.depth, camera, rope)
    places = crossing_fractions(shape)
    if len(places) != len(found.crossings):
        return None
    for place, seen in zip(places, found.crossings, strict=True):
        first, second = np.interp(place, np.linspace(0.0, 1.0, len(shape)), shape[:, 2])
        if (first > second) != seen.first_over:
            shape = exchange_heights(shape, *place, rope)
    return shape

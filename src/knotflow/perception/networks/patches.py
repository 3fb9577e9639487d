"""Patches: squares of the plane through a flat rope's axis, turned along it, that a network sees.

A vertex is given by the point of this plane that hides it from the camera, and its height, so that
the network needs to know neither the camera nor where on the table the rope lies.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.segmentation import Segmentation
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.simulation import RopeConfig

Floats = NDArray[np.float64]
Array = TypeVar("Array", Floats, Tensor)

MARGIN = 1.1
"""Side of a patch, in extents of the rope."""
SMALLEST = 0.4
"""Least side of a patch, in lengths of the rope."""
HIGHEST = 8.0
"""Heights above the table are cut here, radii of the rope."""
FLIPS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
"""A patch's mirror images: signs of its first and second axis."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A square of the plane z = `radius`, the rope's, around `centre` (2,), side 2 `half`, metres;
    columns of `axes` (2, 2) are its axes, which may be left-handed, in the world."""

    centre: Floats
    axes: Floats
    half: float
    radius: float

    @classmethod
    def around(cls, places: NDArray, radius: float, length: float) -> Patch:
        """The patch of a rope of which places (N, 2) of the plane are seen, metres; the directions
        of its axes are arbitrary."""
        middle = places.mean(axis=0)
        _, axes = np.linalg.eigh(np.cov((places - middle).T))
        axes = axes[:, ::-1].copy()  # torch knows no negative strides
        along = (places - middle) @ axes
        low, high = along.min(axis=0), along.max(axis=0)
        half = max(0.5 * MARGIN * float((high - low).max()), 0.5 * SMALLEST * length)
        return cls(middle + axes @ (0.5 * (low + high)), axes, half, radius)

    def flipped(self, along: int, across: int) -> Patch:
        """The same square with its axes times +1 or -1."""
        return Patch(self.centre, self.axes * [along, across], self.half, self.radius)

    def crop(
        self, segmentation: Segmentation, share: NDArray, camera: Camera, size: int
    ) -> NDArray[np.float32]:
        """What the camera sees of the patch, from the rope's `share` (H, W) of each pixel, 0..1.

        Returns:
            (3, size, size), rows along the patch's second axis: the rope's share of each pixel, its
            height there in radii (0 where there is no rope), and how much is known.
        """
        from scipy.ndimage import map_coordinates

        seen = segmentation.known
        deep = seen & np.isfinite(segmentation.height)
        height = np.where(deep, segmentation.height, 0.0) / self.radius
        fine = (np.arange(2 * size) + 0.5) / size - 1.0  # twice as fine, then averaged
        across, along = np.meshgrid(fine, fine, indexing="ij")
        places = self.centre + self.half * np.stack([along, across], axis=-1) @ self.axes.T
        world = np.concatenate([places, np.full_like(places[..., :1], self.radius)], axis=-1)
        column, row, _ = np.moveaxis(camera.project(world), -1, 0)
        at = np.nan_to_num(np.stack([row, column]), nan=-9.0)
        images = [
            map_coordinates(one.astype(np.float32), at, order=1, cval=0.0)
            for one in (share, share * deep, share * deep * height.clip(0.0, HIGHEST), seen)
        ]
        covered, weight, raised, known = (
            one.reshape(size, 2, size, 2).mean(axis=(1, 3)) for one in images
        )
        raised = covered * raised / np.maximum(weight, 1e-3)
        return np.stack([covered, raised, known]).astype(np.float32)

    def to_world(self, nodes: NDArray, camera: Camera) -> Floats:
        """Points (V, 3), metres, of nodes (V, 3): place in the patch, -1..1, and height, radii."""
        eye = camera.position
        places = self.centre + self.half * nodes[:, :2] @ self.axes.T
        height = self.radius * nodes[:, 2:]
        reach = (eye[2] - height) / (eye[2] - self.radius)
        return np.concatenate([eye[:2] + (places - eye[:2]) * reach, height], axis=1)

    def from_world(self, points: NDArray, camera: Camera) -> Floats:
        """Nodes (V, 3) of points (V, 3), the inverse of `to_world`."""
        places = project_to_plane(points, camera.position, self.radius)
        nodes = (places - self.centre) @ self.axes / self.half
        return np.column_stack([nodes, points[:, 2] / self.radius])


def project_to_plane(points: Array, eye: Array, radius: float) -> Array:
    """The places (..., 2) of the plane z = radius that an eye (..., 3) sees points (..., 3) at."""
    reach = (eye[..., 2:] - radius) / (eye[..., 2:] - points[..., 2:])
    return eye[..., :2] + (points[..., :2] - eye[..., :2]) * reach


def crop_rope(
    segmentation: Segmentation, share: NDArray, camera: Camera, rope: RopeConfig, size: int
) -> tuple[Patch, NDArray[np.float32]]:
    """The rope's patch, and what is seen of it (3, size, size), see `Patch.crop`.

    Raises:
        TraceError: there is no rope in the segmentation.
    """
    places = camera.on_plane(segmentation.rope, rope.radius)
    if len(places) < 2:
        raise TraceError("no rope is seen, so none can be proposed")
    patch = Patch.around(places, rope.radius, rope.length)
    return patch, patch.crop(segmentation, share, camera, size)


def mirrored(crop: Tensor) -> Iterable[Tensor]:
    """The crop (3, S, S) in each of `FLIPS`."""
    for along, across in FLIPS:
        axes = [axis for axis, sign in ((2, along), (1, across)) if sign < 0]
        yield crop.flip(axes) if axes else crop

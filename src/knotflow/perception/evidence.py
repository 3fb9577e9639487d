"""What an image says of a rope, and how much of that a shape accounts for."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.losses import CORRELATED, Target
from knotflow.perception.rendering import render
from knotflow.perception.segmentation import segment
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig

_CLEARLY = 0.7  # difference in the share of a pixel that is rope, which is no matter of edges
_SOFTNESS = 1.5e-3  # metres, at which silhouettes are compared
_AROUND = 1.2  # widths of the rope from its centre line, within which its thickness is measured
_CORRELATED = 0.7  # widths of the rope, within which errors of its shape are the same error
_RADII = (0.7, 1.4)  # thinnest and thickest that it can look, in its radius


def observe(image: RgbdImage, camera: Camera, rope: RopeConfig) -> Target:
    """What an image says of a rope: its pixels are separated from table and gripper, see `segment`.

    Raises:
        ImageError: an image of another size.
    """
    segmentation = segment(image, camera, rope.radius)
    known = segmentation.rope | (segmentation.labels == Label.TABLE)
    share = coverage(image, segmentation)
    depth = np.where(known, image.depth, np.nan)
    width = 2 * rope.radius * pixels_per_metre(segmentation.rope, image, camera)
    correlated = max(CORRELATED, (_CORRELATED * width) ** 2)
    return Target.of(segmentation.rope, known, depth, share, correlated)


def pixels_per_metre(mask: NDArray, image: RgbdImage, camera: Camera) -> float:
    """How many pixels a metre is long in an image, where its rope is seen, the `mask` (H, W)."""
    visible = image.depth[mask]
    distance = float(np.nanmedian(visible)) if np.isfinite(visible).any() else 1.0
    return camera.fx / distance


def explained(shape: NDArray, target: Target, camera: Camera, rope: RopeConfig) -> float:
    """Share of the rope's image that a shape (V, 3) accounts for, 0..1.

    Rope where the shape has none, and shape where there is none, both count against it; pixels at
    the rope's edges, which are rope in part, for neither.
    """
    with torch.no_grad():
        radius = target.seen_radius or rope.radius
        _, occupancy = render(torch.as_tensor(shape), radius, camera)
    wrong = ((occupancy - target.coverage).abs() > _CLEARLY) & target.known
    return max(0.0, 1 - float(wrong.sum() / target.coverage.sum().clamp(min=1)))


def measure_radius(shape: NDArray, target: Target, camera: Camera, rope: RopeConfig) -> float:
    """The radius, metres, at which a shape (V, 3) looks as thick as the rope in the image.

    It is measured where the shape lies on the rope; where it never does it is the rope's own.
    """
    from scipy.optimize import minimize_scalar
    from scipy.spatial import cKDTree

    points = torch.as_tensor(shape)
    at = np.linspace(0, len(shape) - 1, 5 * len(shape))
    fine = np.stack([np.interp(at, range(len(shape)), one) for one in shape.T], axis=1)
    column, row, depth = camera.project(fine).T
    rows, columns = np.indices(target.rope.shape).reshape(2, -1)
    distance, nearest = cKDTree(np.stack([column, row], 1)).query(np.stack([columns, rows], 1))
    width = 2 * rope.radius * camera.fx / float(depth.mean())
    near = target.rope.numpy()[nearest_pixels(fine, camera)][nearest] & (distance < _AROUND * width)
    looked_at = torch.as_tensor(near).view_as(target.known) & target.known

    if not looked_at.any():
        return rope.radius

    def misfit(radius: float) -> float:
        with torch.no_grad():
            _, occupancy = render(points, radius, camera, _SOFTNESS)
        return float(((occupancy - target.coverage).square() * looked_at).sum())

    limits = [share * rope.radius for share in _RADII]
    return float(minimize_scalar(misfit, bounds=limits, options={"xatol": 0.01 * rope.radius}).x)


def seen(
    shape: NDArray, mask: NDArray, image: RgbdImage, camera: Camera, rope: RopeConfig
) -> NDArray[np.bool_]:
    """(V,) whether the image shows the rope, its `mask` (H, W), where the vertex is, and no other
    strand above it."""
    column, row, depth = camera.project(shape).T
    inside = (np.abs(column - (camera.width - 1) / 2) < camera.width / 2) & (
        np.abs(row - (camera.height - 1) / 2) < camera.height / 2
    )
    shown = nearest_pixels(shape, camera)
    off = np.abs(image.depth[shown] - (depth - rope.radius))
    return np.asarray(inside & mask[shown] & (off < 1.5 * rope.radius))


def nearest_pixels(points: NDArray, camera: Camera) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (N,) at which points (N, 3) are seen, the nearest in the image."""
    u, v, _ = np.nan_to_num(camera.project(points)).T
    return (
        np.clip(np.round(v), 0, camera.height - 1).astype(np.intp),
        np.clip(np.round(u), 0, camera.width - 1).astype(np.intp),
    )

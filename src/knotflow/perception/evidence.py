"""What an image says of a rope, and how much of that a shape accounts for."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.losses import Target
from knotflow.perception.rendering import render
from knotflow.perception.segmentation import segment
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig

_CLEARLY = 0.7  # difference in the share of a pixel that is rope, which is no matter of edges


def observe(image: RgbdImage, camera: Camera, rope: RopeConfig) -> Target:
    """What an image says of a rope: its pixels are told from table and gripper, see `segment`.

    Raises:
        ImageError: an image of another size.
    """
    segmentation = segment(image, camera, rope.radius)
    known = segmentation.rope | (segmentation.labels == Label.TABLE)
    share = coverage(image, segmentation)
    return Target.of(segmentation.rope, known, np.where(known, image.depth, np.nan), share)


def explained(shape: NDArray, target: Target, camera: Camera, rope: RopeConfig) -> float:
    """Share of the rope's image that a shape (V, 3) accounts for, 0..1.

    Rope where the shape has none, and shape where there is none, both count against it; pixels at
    the rope's edges, which are rope in part, for neither.
    """
    with torch.no_grad():
        _, occupancy = render(torch.as_tensor(shape), rope.radius, camera)
    wrong = ((occupancy - target.coverage).abs() > _CLEARLY) & target.known
    return max(0.0, 1 - float(wrong.sum() / target.coverage.sum().clamp(min=1)))


def seen(
    shape: NDArray, mask: NDArray, image: RgbdImage, camera: Camera, rope: RopeConfig
) -> NDArray[np.bool_]:
    """(V,) whether the image shows the rope, its `mask` (H, W), where the vertex is, and no other
    strand above it."""
    column, row, depth = camera.project(shape).T
    inside = (np.abs(column - (camera.width - 1) / 2) < camera.width / 2) & (
        np.abs(row - (camera.height - 1) / 2) < camera.height / 2
    )
    u = np.clip(np.nan_to_num(np.round(column)), 0, camera.width - 1).astype(int)
    v = np.clip(np.nan_to_num(np.round(row)), 0, camera.height - 1).astype(int)
    off = np.abs(image.depth[v, u] - (depth - rope.radius))
    return np.asarray(inside & mask[v, u] & (off < 1.5 * rope.radius))

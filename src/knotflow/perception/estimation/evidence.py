"""What an image says of a rope, and how much of that a shape accounts for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.rendering import render
from knotflow.perception.estimation.segmentation import pixel_coverage, segment
from knotflow.simulation import RopeConfig

CORRELATED = 4.0
"""Pixels that share their error, as neighbours do."""
_BORDER = 2  # pixels: the last one may have lost its depth
_CLEAR_DIFFERENCE = 0.7  # in the share of a pixel that is rope: more than at an edge
_SOFTNESS = 1.5e-3  # metres, at which silhouettes are compared
_AROUND = 1.2  # widths of the rope from its centre line, within which its thickness is measured
_CORRELATED_WIDTHS = 0.7  # widths of the rope, within which errors of its shape are the same error
_RADII = (0.7, 1.4)  # smallest and largest apparent radius, in the rope's


@dataclass(frozen=True, eq=False)
class Target:
    """What an image says about a rope."""

    rope: Tensor
    """(H, W) bool, pixels on the rope."""
    known: Tensor
    """(H, W) bool, pixels that nothing else hides: rope or table."""
    depth: Tensor
    """(H, W) metres along the optical axis, NaN where unknown."""
    coverage: Tensor
    """(H, W) share of each pixel that is rope, 0..1."""
    seen_radius: float | None = None
    """Of the rope's silhouette, metres: blur, light and noise change it; None is the rope's."""
    correlated: float = CORRELATED
    """So many pixels of rope share their error, and count as one."""

    @classmethod
    def of(
        cls,
        rope: NDArray,
        known: NDArray,
        depth: NDArray,
        coverage: NDArray | None = None,
        correlated: float = CORRELATED,
    ) -> Target:
        """From arrays of the same contents; without `coverage` pixels are rope or not."""
        return cls(
            torch.as_tensor(rope.copy()),
            torch.as_tensor(known.copy()),
            torch.as_tensor(depth).double(),
            torch.as_tensor(rope if coverage is None else coverage).double(),
            correlated=correlated,
        )

    @property
    def independent_pixels(self) -> float:
        """Pixels of rope with independent errors: a loss times these is the negative logarithm of a
        likelihood."""
        return float(self.rope.sum()) / self.correlated

    @property
    def leaves_image(self) -> bool:
        """Whether rope is seen at the border of the image."""
        inner = self.rope[_BORDER:-_BORDER, _BORDER:-_BORDER]
        return bool(self.rope.sum() > inner.sum())

    def required_coverage(self, fraction: float) -> float:
        """A coverage fraction that is demanded of images of 320 pixels, in this image: in finer
        ones less of the rope is edge, where pixels err."""
        return 1.0 - (1.0 - fraction) * (CORRELATED / self.correlated) ** 0.5

    def cropped(self, rows: slice, columns: slice) -> Target:
        """The same for a camera `cropped` to these rows and columns."""
        names = ("rope", "known", "depth", "coverage")
        return replace(self, **{name: getattr(self, name)[rows, columns] for name in names})

    def binned(self, factor: int) -> Target:
        """The same for a camera `binned` by that factor."""
        height, width = (size // factor * factor for size in self.rope.shape)

        def squares(values: Tensor) -> Tensor:
            cut = values[:height, :width].reshape(height // factor, factor, width // factor, factor)
            return cut.movedim(1, 2).flatten(2)

        depth, rope = squares(self.depth), squares(self.rope)
        on_rope = depth.where(rope | ~rope.any(2, keepdim=True), torch.nan)
        return Target(
            rope.double().mean(2) >= 0.5,
            squares(self.known).all(2),
            on_rope.nanmean(2),
            squares(self.coverage).mean(2),
            self.seen_radius,
            max(CORRELATED, self.correlated / factor**2),
        )


def observe(image: RgbdImage, camera: Camera, rope: RopeConfig) -> Target:
    """What an image says of a rope, by its segmentation.

    Raises:
        ImageError: an image of another size.
    """
    segmentation = segment(image, camera, rope.radius)
    share = pixel_coverage(image, segmentation)
    depth = np.where(segmentation.known, image.depth, np.nan)
    width = 2 * rope.radius * pixels_per_metre(segmentation.rope, image, camera)
    correlated = max(CORRELATED, (_CORRELATED_WIDTHS * width) ** 2)
    return Target.of(segmentation.rope, segmentation.known, depth, share, correlated)


def pixels_per_metre(mask: NDArray, image: RgbdImage, camera: Camera) -> float:
    """Pixels a metre at the distance of the rope, whose pixels are the `mask` (H, W)."""
    visible = image.depth[mask]
    distance = float(np.nanmedian(visible)) if np.isfinite(visible).any() else 1.0
    return camera.fx / distance


def coverage_fraction(shape: NDArray, target: Target, camera: Camera, rope: RopeConfig) -> float:
    """Fraction of the rope's image that a shape (V, 3) accounts for, 0..1.

    Rope where the shape has none, and shape where there is no rope, count against it.
    """
    with torch.no_grad():
        radius = target.seen_radius or rope.radius
        _, occupancy = render(torch.as_tensor(shape), radius, camera)
    wrong = ((occupancy - target.coverage).abs() > _CLEAR_DIFFERENCE) & target.known
    return max(0.0, 1 - float(wrong.sum() / target.coverage.sum().clamp(min=1)))


def measure_radius(shape: NDArray, target: Target, camera: Camera, rope: RopeConfig) -> float:
    """The radius, metres, at which a shape (V, 3) looks as thick as the rope in the image, measured
    where the shape is on the rope; the rope's own where it never is."""
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
    compared = torch.as_tensor(near).view_as(target.known) & target.known
    if not compared.any():
        return rope.radius

    def misfit(radius: float) -> float:
        with torch.no_grad():
            _, occupancy = render(points, radius, camera, _SOFTNESS)
        return float(((occupancy - target.coverage).square() * compared).sum())

    limits = [share * rope.radius for share in _RADII]
    return float(minimize_scalar(misfit, bounds=limits, options={"xatol": 0.01 * rope.radius}).x)


def visible_vertices(
    shape: NDArray, mask: NDArray, image: RgbdImage, camera: Camera, rope: RopeConfig
) -> NDArray[np.bool_]:
    """(V,) whether the image shows rope, its `mask` (H, W), at a vertex, and no strand above it."""
    column, row, depth = camera.project(shape).T
    inside = (np.abs(column - (camera.width - 1) / 2) < camera.width / 2) & (
        np.abs(row - (camera.height - 1) / 2) < camera.height / 2
    )
    pixels = nearest_pixels(shape, camera)
    off = np.abs(image.depth[pixels] - (depth - rope.radius))
    return np.asarray(inside & mask[pixels] & (off < 1.5 * rope.radius))


def nearest_pixels(points: NDArray, camera: Camera) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (N,) of the pixels nearest to points (N, 3), metres, within the image."""
    u, v, _ = np.nan_to_num(camera.project(points)).T
    return (
        np.clip(np.round(v), 0, camera.height - 1).astype(np.intp),
        np.clip(np.round(u), 0, camera.width - 1).astype(np.intp),
    )

"""What an image says of a rope, and how much of that a shape accounts for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree
from torch import Tensor

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.rendering import render
from knotflow.perception.estimation.segmentation import pixel_coverage, segment
from knotflow.simulation import RopeConfig
from knotflow.topology.polyline import Floats, interpolate

CORRELATED = 4.0  # pixels that share their error, as neighbours do
_CORRELATED_WIDTHS = 0.7  # widths of the rope, within which errors of its shape are the same error
_PIXELS_ACROSS = 1.4  # a rope's width on the coarser grid
_BORDER = 2  # pixels: the last one may have lost its depth
_MARGIN = 10  # pixels around what is seen of a rope, that a fit looks at
_CLEAR_DIFFERENCE = 0.7  # in the share of a pixel that is rope: more than at an edge
_SOFTNESS = 1.5e-3  # metres, at which silhouettes are compared
_AROUND = 1.2  # widths of the rope from its centre line, within which its thickness is measured
_RADII = (0.7, 1.4)  # smallest and largest apparent radius, in the rope's
_HEAD_VERTICES = 2  # that have the head's colour
_HEAD_CONTRAST = 0.15  # distance in RGB (0..1) from the rope's colour that marks a head


@dataclass(frozen=True, eq=False)
class Target:
    """What an image (H, W) of a camera says of a rope."""

    camera: Camera
    rope: RopeConfig
    mask: Tensor  # (H, W) bool, pixels on the rope
    known: Tensor  # (H, W) bool, pixels that nothing else hides: rope or table
    depth: Tensor  # (H, W) metres along the optical axis, NaN where unknown
    height: Tensor  # (H, W) metres above the table, NaN without depth
    coverage: Tensor  # (H, W) share of each pixel that is rope, 0..1
    seen_radius: float | None = None
    """Of the rope's silhouette, metres: blur, light and noise change it; None is the rope's."""
    seen_length: float | None = None  # of the rope by its colours alone, metres
    correlated: float = CORRELATED  # so many pixels of rope share their error, and count as one

    @property
    def independent_pixels(self) -> float:
        """Pixels with independent errors; a loss times these is a negative log likelihood."""
        return float(self.mask.sum()) / self.correlated

    @property
    def leaves_image(self) -> bool:
        """Whether rope is seen at the border of the image."""
        inner = self.mask[_BORDER:-_BORDER, _BORDER:-_BORDER]
        return bool(self.mask.sum() > inner.sum())

    def required_coverage(self, fraction: float) -> float:
        """A coverage fraction that is demanded of a rope three pixels wide, in this image: of a
        wider one less is edge, where pixels err."""
        return 1.0 - (1.0 - fraction) * (CORRELATED / self.correlated) ** 0.5

    def occupancy(self, shape: NDArray) -> Tensor:
        """Share (H, W) of each pixel that a shape (V, 3) covers, as thick as the rope is seen."""
        with torch.no_grad():
            radius = self.seen_radius or self.rope.radius
            return render(torch.as_tensor(shape), radius, self.camera)[1]

    def around(self, shapes: Sequence[NDArray]) -> Target:
        """The part of the image around its rope and shapes (V, 3)."""
        drawn = np.concatenate([*shapes, np.empty((0, 3))])
        u, v, _ = np.nan_to_num(self.camera.project(drawn)).round().astype(int).T
        spans = []
        for seen, places, size in zip(
            self.mask.numpy().nonzero(), (v, u), self.mask.shape, strict=True
        ):
            inside = np.clip(np.r_[seen, places], 0, size - 1)
            low, high = int(inside.min()) - _MARGIN, int(inside.max()) + _MARGIN + 1
            spans.append(slice(max(0, low), min(size, high)))
        rows, columns = spans
        parts = {
            name: getattr(self, name)[rows, columns]
            for name in ("mask", "known", "depth", "height", "coverage")
        }
        return replace(self, camera=self.camera.cropped(rows, columns), **parts)

    def coarse(self, shape: NDArray) -> Target:
        """The same on a grid on which a rope along a shape (V, 3) is hardly wider than a pixel."""
        return self.binned(self.camera.binning(shape, 2 * self.rope.radius, _PIXELS_ACROSS))

    def binned(self, factor: int) -> Target:
        """The same for a camera `binned` by that factor."""
        height, width = (size // factor * factor for size in self.mask.shape)

        def squares(values: Tensor) -> Tensor:
            cut = values[:height, :width].reshape(height // factor, factor, width // factor, factor)
            return cut.movedim(1, 2).flatten(2)

        depth, mask = squares(self.depth), squares(self.mask)
        on_rope = depth.where(mask | ~mask.any(2, keepdim=True), torch.nan)
        return Target(
            self.camera.binned(factor),
            self.rope,
            mask.double().mean(2) >= 0.5,
            squares(self.known).all(2),
            on_rope.nanmean(2),
            squares(self.height).nanmean(2),
            squares(self.coverage).mean(2),
            self.seen_radius,
            self.seen_length,
            max(CORRELATED, self.correlated / factor**2),
        )


def observe(image: RgbdImage, camera: Camera, rope: RopeConfig) -> Target:
    """What an image says of a rope, by its segmentation.

    Raises:
        ImageError: an image of another size.
    """
    segmentation = segment(image, camera, rope.radius)
    mask, known = segmentation.rope, segmentation.known
    depth = np.where(known, image.depth, np.nan).astype(np.float64)
    share = pixel_coverage(image, segmentation)
    width = 2 * rope.radius * pixels_per_metre(mask, image, camera)
    correlated = max(CORRELATED, (_CORRELATED_WIDTHS * width) ** 2)
    return Target(
        camera,
        rope,
        torch.as_tensor(mask),
        torch.as_tensor(known),
        torch.as_tensor(depth),
        torch.as_tensor(segmentation.height),
        torch.as_tensor(share),
        correlated=correlated,
    )


def pixels_per_metre(mask: NDArray, image: RgbdImage, camera: Camera) -> float:
    """Pixels a metre at the distance of the rope, whose pixels are the `mask` (H, W)."""
    visible = image.depth[mask]
    distance = float(np.nanmedian(visible)) if np.isfinite(visible).any() else 1.0
    return camera.fx / distance


def coverage_fraction(shape: NDArray, target: Target) -> float:
    """Fraction of the rope's image that a shape (V, 3) accounts for, 0..1; rope where the shape has
    none, and shape where there is no rope, count against it."""
    off = (target.occupancy(shape) - target.coverage).abs()
    wrong = (off > _CLEAR_DIFFERENCE) & target.known
    return max(0.0, 1 - float(wrong.sum() / target.coverage.sum().clamp(min=1)))


def measure_radius(shape: NDArray, target: Target) -> float:
    """The radius, metres, at which a shape (V, 3) looks as thick as the rope in the image, measured
    where the shape is on the rope; the rope's own where it never is."""
    camera, radius = target.camera, target.rope.radius
    points = torch.as_tensor(shape)
    at = np.linspace(0, len(shape) - 1, 5 * len(shape))
    fine = interpolate(at, np.arange(len(shape)), shape)
    column, row, depth = camera.project(fine).T
    rows, columns = np.indices(target.mask.shape).reshape(2, -1)
    distance, nearest = cKDTree(np.stack([column, row], 1)).query(np.stack([columns, rows], 1))
    width = 2 * radius * camera.fx / float(depth.mean())
    on_rope = target.mask.numpy()[camera.nearest_pixels(fine)]
    near = on_rope[nearest] & (distance < _AROUND * width)
    compared = torch.as_tensor(near).view_as(target.known) & target.known
    if not compared.any():
        return radius

    def misfit(radius: float) -> float:
        with torch.no_grad():
            _, occupancy = render(points, radius, camera, _SOFTNESS)
        return float(((occupancy - target.coverage).square() * compared).sum())

    limits = [share * radius for share in _RADII]
    return float(minimize_scalar(misfit, bounds=limits, options={"xatol": 0.01 * radius}).x)


def visible_vertices(
    shape: NDArray, mask: NDArray, image: RgbdImage, camera: Camera, rope: RopeConfig
) -> NDArray[np.bool_]:
    """(V,) whether the image shows rope, its `mask` (H, W), at a vertex, and no strand above it."""
    column, row, depth = camera.project(shape).T
    inside = (np.abs(column - (camera.width - 1) / 2) < camera.width / 2) & (
        np.abs(row - (camera.height - 1) / 2) < camera.height / 2
    )
    pixels = camera.nearest_pixels(shape)
    off = np.abs(image.depth[pixels] - (depth - rope.radius))
    return np.asarray(inside & mask[pixels] & (off < 1.5 * rope.radius))


def head_contrast(shape: NDArray, target: Target, image: RgbdImage) -> Floats:
    """(V,) distance in RGB (0..1) of the colour at each vertex of a shape (V, 3) from the rope's; 0
    where no pixel of rope is nearest to the vertex."""
    mask, found = target.mask.numpy(), np.zeros(len(shape))
    if not mask.any():
        return found
    column, row, _ = target.camera.project(shape).T
    pixels = np.argwhere(mask)
    nearest = np.hypot(pixels[:, :1] - row, pixels[:, 1:] - column).argmin(axis=1)
    colours = image.rgb[mask] / 255.0
    plain = np.median(colours, axis=0)
    for vertex in np.unique(nearest):
        found[vertex] = np.linalg.norm(np.median(colours[nearest == vertex], axis=0) - plain)
    return found


def find_head(contrasts: NDArray, least: float = _HEAD_CONTRAST) -> int | None:
    """0 where the first vertices are of another colour than the rope, -1 where the last are; None
    where neither stand out by `least`, and twice as much as the other."""
    first, last = contrasts[:_HEAD_VERTICES].max(), contrasts[-_HEAD_VERTICES:].max()
    if max(first, last) <= max(least, 2 * min(first, last)):
        return None
    return 0 if first > last else -1


def is_head_inside(contrasts: NDArray, least: float = _HEAD_CONTRAST) -> bool:
    """Whether a head is seen along the shape, where it cannot be."""
    ends = max(contrasts[:_HEAD_VERTICES].max(), contrasts[-_HEAD_VERTICES:].max())
    along = contrasts[_HEAD_VERTICES:-_HEAD_VERTICES].max(initial=0.0)
    return bool(along > max(least, 2 * ends))

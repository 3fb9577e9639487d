"""What a rope's shape has to account for: the image, its own length and bending, and the table.

The losses in image space compare a rendering with an image where the image knows (Sec. VI, there
for RGB, here with depth as well); the others are priors on what the image does not show. Each is
about one where the shape is plainly wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import huber_loss

from knotflow.perception.overlap import overlap

CORRELATED = 4.0
"""Pixels that share their error, as neighbours do."""


@dataclass(frozen=True, eq=False)
class Target:
    """What an image says about a rope.

    Attributes:
        rope: (H, W) bool, pixels on the rope.
        known: (H, W) bool, pixels of which it is known whether they are on the rope; False where
            something hides the table.
        depth: (H, W) metres along the optical axis, NaN where unknown.
        coverage: (H, W) share of each pixel that is rope, 0..1.
        seen_radius: of the rope's silhouette, metres; None where it is taken for the rope's. Ropes
            are not as thick as they are said to be, and blur, light and noise thicken or thin them.
        correlated: so many pixels of rope share their error, and count as one.
    """

    rope: Tensor
    known: Tensor
    depth: Tensor
    coverage: Tensor
    seen_radius: float | None = None
    correlated: float = CORRELATED

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
        """Pixels of rope whose errors are independent: a loss times these is the negative logarithm
        of a likelihood."""
        return float(self.rope.sum()) / self.correlated

    def nearly(self, share: float) -> float:
        """A share of the rope's image as close to all of it as `share` is in images as coarse as
        ropes are mostly seen in: in finer ones, less of the rope is edge, where pixels err."""
        return 1.0 - (1.0 - share) * (CORRELATED / self.correlated) ** 0.5

    def cropped(self, rows: slice, columns: slice) -> Target:
        """The same for a camera `cropped` to these rows and columns."""
        rope, known, depth, coverage = (
            one[rows, columns] for one in (self.rope, self.known, self.depth, self.coverage)
        )
        return Target(rope, known, depth, coverage, self.seen_radius, self.correlated)

    def binned(self, factor: int) -> Target:
        """The same for a camera `binned` by that factor: each pixel holds a square of these."""
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


def silhouette_loss(occupancy: Tensor, target: Target) -> Tensor:
    """Squared difference of the share of each known pixel that is rope, per pixel of rope; of
    images (..., H, W), for each."""
    difference = (occupancy - target.coverage.to(occupancy)) * target.known
    return difference.square().sum((-2, -1)) / target.rope.sum().clamp(min=1)


def depth_loss(depth: Tensor, occupancy: Tensor, target: Target, scale: float) -> Tensor:
    """Huber loss of the depth in units of `scale`, metres, per pixel of rope; of images
    (..., H, W), for each.

    Pixels count by their occupancy, which gets no gradient: to leave a pixel is no way to
    account for its depth.
    """
    both = target.rope & ~target.depth.isnan() & ~depth.isnan()
    error = ((depth - target.depth) / scale).where(both, 0.0)
    each = huber_loss(error, torch.zeros_like(error), reduction="none") * occupancy.detach()
    return each.sum((-2, -1)) / target.rope.sum().clamp(min=1)


def length_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared relative error of the links' lengths, in tenths; points (..., V, 3) metres."""
    lengths = (points[..., 1:, :] - points[..., :-1, :]).norm(dim=-1)
    return ((lengths / link_length - 1) / 0.1).square().mean(-1)


def bending_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared change of bend from vertex to vertex, radians: ropes bend smoothly.

    Bending itself is not held against a rope, or its loops would shrink.
    """
    bend = torch.diff(points, n=2, dim=-2) / link_length
    return torch.diff(bend, dim=-2).square().sum(-1).mean(-1)


def table_loss(points: Tensor, radius: float) -> Tensor:
    """Squared depth of the rope in the table at z = 0, in radii, the mean over vertices."""
    return (1 - points[..., 2] / radius).clamp(min=0).square().mean(-1)


def overlap_loss(points: Tensor, radius: float) -> Tensor:
    """Squared depth of strands in each other, in radii, summed over pairs of links."""
    ropes = points.reshape(-1, *points.shape[-2:]).double()  # (B, V, 3)
    return _Overlap.apply(ropes, radius).view(points.shape[:-2]).to(points)


class _Overlap(torch.autograd.Function):
    """`overlap` of ropes (B, V, 3), (B,)."""

    @staticmethod
    def forward(ctx: Any, ropes: Tensor, radius: float) -> Tensor:
        loss, slope = overlap(np.ascontiguousarray(ropes.detach().numpy()), radius)
        ctx.slope = torch.from_numpy(slope)
        return torch.from_numpy(loss)

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        return slopes[0][:, None, None] * ctx.slope, None

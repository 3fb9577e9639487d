"""What a rope's shape has to account for: the image, its own length and bending, and the table.

The losses in image space compare a rendering with an image where the image knows (Sec. VI, there
for RGB, here with depth as well); the others are priors on what the image does not show. Each is
about one where the shape is plainly wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import huber_loss


@dataclass(frozen=True, eq=False)
class Target:
    """What an image says about a rope.

    Attributes:
        rope: (H, W) bool, pixels on the rope.
        known: (H, W) bool, pixels of which it is known whether they are on the rope; False where
            something hides the table.
        depth: (H, W) metres along the optical axis, NaN where unknown.
        coverage: (H, W) share of each pixel that is rope, 0..1.
    """

    rope: Tensor
    known: Tensor
    depth: Tensor
    coverage: Tensor

    @classmethod
    def of(
        cls, rope: NDArray, known: NDArray, depth: NDArray, coverage: NDArray | None = None
    ) -> Target:
        """From arrays of the same contents; without `coverage` pixels are rope or not."""
        return cls(
            torch.as_tensor(rope.copy()),
            torch.as_tensor(known.copy()),
            torch.as_tensor(depth).double(),
            torch.as_tensor(rope if coverage is None else coverage).double(),
        )

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
        )


def silhouette_loss(occupancy: Tensor, target: Target) -> Tensor:
    """Squared difference of the share of each known pixel that is rope, per pixel of rope."""
    difference = (occupancy - target.coverage.to(occupancy))[target.known]
    return difference.square().sum() / target.rope.sum().clamp(min=1)


def depth_loss(depth: Tensor, occupancy: Tensor, target: Target, scale: float) -> Tensor:
    """Huber loss of the depth in units of `scale`, metres, per pixel of rope.

    Pixels count by their occupancy, which gets no gradient: to leave a pixel is no way to
    account for its depth.
    """
    both = target.rope & ~target.depth.isnan() & ~depth.isnan()
    error = (depth[both] - target.depth[both]) / scale
    each = huber_loss(error, torch.zeros_like(error), reduction="none")
    return (each * occupancy[both].detach()).sum() / target.rope.sum().clamp(min=1)


def length_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared relative error of the links' lengths, in units of a tenth; points (V, 3) metres."""
    lengths = (points[1:] - points[:-1]).norm(dim=1)
    return ((lengths / link_length - 1) / 0.1).square().mean()


def bending_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared change of bend from vertex to vertex, radians: ropes bend smoothly.

    Bending itself is not held against a rope, or its loops would shrink.
    """
    bend = (points[2:] - 2 * points[1:-1] + points[:-2]) / link_length
    return (bend[1:] - bend[:-1]).square().sum(1).mean()


def table_loss(points: Tensor, radius: float) -> Tensor:
    """Squared depth of the rope in the table at z = 0, in radii, the mean over vertices."""
    return (1 - points[:, 2] / radius).clamp(min=0).square().mean()


def overlap_loss(points: Tensor, radius: float) -> Tensor:
    """Squared depth of strands in each other, in radii, summed over pairs of links."""
    links = len(points) - 1
    one, other = torch.triu_indices(links, links, offset=3)
    middle = 0.5 * (points[1:] + points[:-1]).detach()
    longest = float((points[1:] - points[:-1]).detach().norm(dim=1).max())
    near = (middle[one] - middle[other]).norm(dim=1) < longest + 2 * radius
    distance = segment_distance(points, one[near], other[near])
    return (2 - distance / radius).clamp(min=0).square().sum()


def segment_distance(points: Tensor, one: Tensor, other: Tensor) -> Tensor:
    """Distance (N,) of links `one` and `other` (N,) of a rope (V, 3), metres.

    Source: Ericson, Real-Time Collision Detection, Sec. 5.1.9.
    """
    start, end = points[:-1], points[1:]
    p, d = start[one], end[one] - start[one]
    q, e = start[other], end[other] - start[other]
    r = p - q
    dd, ee, de = (d * d).sum(1), (e * e).sum(1), (d * e).sum(1)
    dr, er = (d * r).sum(1), (e * r).sum(1)
    s = ((de * er - dr * ee) / (dd * ee - de * de + 1e-12)).clamp(0, 1)
    t = ((de * s + er) / (ee + 1e-12)).clamp(0, 1)
    s = ((de * t - dr) / (dd + 1e-12)).clamp(0, 1)
    gap = r + s[:, None] * d - t[:, None] * e
    return (gap.square().sum(1) + 1e-14).sqrt()

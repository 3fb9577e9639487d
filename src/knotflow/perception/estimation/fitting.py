"""A rope's shape by gradient steps on the losses of its rendering (Sec. VI, [15]), with depth.

Steps are smoothed along the rope (Nicolet, Jacobson and Jakob, Large Steps in Inverse Rendering of
Geometry, 2021), and links get equal lengths at last.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import huber_loss

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.rendering import render
from knotflow.perception.estimation.chain import overlap, project_lengths
from knotflow.perception.estimation.evidence import Target
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread


@dataclass
class FitConfig:
    """Gradient steps in image space."""

    steps: int = 80
    """Number of gradient steps."""
    step_size: float = 2e-3
    """First step of a coordinate, metres; falls to a tenth as the steps end."""
    softness: tuple[float, float] = (6e-3, 1.5e-3)
    """Softness of the rendering at the first and the last step, metres."""
    depth_scale: float = 5e-3
    """Depth errors beyond this, metres, count linearly."""
    smoothing: float = 3.0
    """How far a vertex takes its neighbours along, links squared."""
    silhouette: float = 1.0
    """Weight of the silhouette in the image."""
    depth: float = 1.0
    """Weight of the depth image; 0 fits to colour alone."""
    length: float = 1.0
    """Weight of the links' lengths."""
    bending: float = 0.05
    """Weight of the change of bend."""
    table: float = 1.0
    """Weight of the table."""
    overlap: float = 0.1
    """Weight of strands in each other."""


def silhouette_loss(occupancy: Tensor, target: Target) -> Tensor:
    """Squared difference of the coverage of known pixels, per pixel of rope, of images
    (..., H, W)."""
    difference = (occupancy - target.coverage.to(occupancy)) * target.known
    return difference.square().sum((-2, -1)) / target.rope.sum().clamp(min=1)


def depth_loss(depth: Tensor, occupancy: Tensor, target: Target, scale: float) -> Tensor:
    """Huber loss of the depth (..., H, W) in units of `scale`, metres, per pixel of rope. Pixels
    count by their occupancy, which gets no gradient: leaving a pixel does not explain its depth."""
    both = target.rope & ~target.depth.isnan() & ~depth.isnan()
    error = ((depth - target.depth) / scale).where(both, 0.0)
    each = huber_loss(error, torch.zeros_like(error), reduction="none") * occupancy.detach()
    return each.sum((-2, -1)) / target.rope.sum().clamp(min=1)


def length_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared relative error of the links' lengths, in tenths; points (..., V, 3) metres."""
    lengths = (points[..., 1:, :] - points[..., :-1, :]).norm(dim=-1)
    return ((lengths / link_length - 1) / 0.1).square().mean(-1)


def bending_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared change of bend from vertex to vertex, radians: a loss on bends would shrink loops."""
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
    @staticmethod
    def forward(ctx: Any, ropes: Tensor, radius: float) -> Tensor:
        loss, slope = overlap(np.ascontiguousarray(ropes.detach().numpy()), radius)
        ctx.slope = torch.from_numpy(slope)
        return torch.from_numpy(loss)

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        return slopes[0][:, None, None] * ctx.slope, None


def image_loss(
    points: Tensor,
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: FitConfig,
    softness: float | None = None,
) -> Tensor:
    """How badly a shape (..., V, 3) accounts for an image: silhouette and depth."""
    softness = config.softness[1] if softness is None else softness
    depth, occupancy = render(points, rope.radius, camera, softness, target.seen_radius)
    return config.silhouette * silhouette_loss(occupancy, target) + config.depth * depth_loss(
        depth, occupancy, target, config.depth_scale
    )


def shape_loss(points: Tensor, rope: RopeConfig, config: FitConfig) -> Tensor:
    """How unlike a rope on a table a shape (..., V, 3) is, whatever the image."""
    return (
        config.length * length_loss(points, rope.link_length)
        + config.bending * bending_loss(points, rope.link_length)
        + config.table * table_loss(points, rope.radius)
        + config.overlap * overlap_loss(points, rope.radius)
    )


def misfit(
    shape: NDArray, target: Target, camera: Camera, rope: RopeConfig, config: FitConfig
) -> float:
    """Negative logarithm of the likelihood of an image if the rope lies in a shape (V, 3)."""
    with torch.no_grad():
        loss = image_loss(torch.as_tensor(shape), target, camera, rope, config)
    return target.independent_pixels * float(loss)


@one_thread()
def fit(
    points: NDArray,
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: FitConfig | None = None,
    prior: Callable[[Tensor], Tensor] | None = None,
) -> NDArray[np.float64]:
    """The shape (V, 3), metres, near a first guess `points` (V, 3) that accounts for an image; many
    guesses (B, V, 3) are fitted each by itself. A `prior` is a further loss of the shape."""
    config = config or FitConfig()
    identity = torch.eye(points.shape[-2], dtype=torch.float64)
    differences = torch.diff(identity, dim=0)
    smooth = torch.linalg.inv(identity + config.smoothing * differences.T @ differences)
    start = torch.tensor(np.ascontiguousarray(points, np.float64))
    moves = torch.zeros_like(start, requires_grad=True)
    optimiser = torch.optim.Adam([moves], lr=config.step_size, betas=(0.8, 0.95), fused=True)
    soft, sharp = config.softness
    for step in range(config.steps):
        softness = soft * (sharp / soft) ** (step / max(1, config.steps - 1))
        shape = start + smooth @ moves
        loss = image_loss(shape, target, camera, rope, config, softness)
        loss = loss + shape_loss(shape, rope, config)
        if prior is not None:
            loss = loss + prior(shape)
        optimiser.zero_grad()
        loss.sum().backward()
        optimiser.step()
        optimiser.param_groups[0]["lr"] *= 0.1 ** (1 / config.steps)
    shapes = (start + smooth @ moves).detach().numpy()
    each = shapes.reshape(-1, *shapes.shape[-2:])
    found = [project_lengths(shape, rope.link_length) for shape in each]
    return np.stack(found).reshape(shapes.shape)

"""A rope's shape by gradient steps on the losses of its rendering (Sec. VI, [15]).

The vertices move freely, held together by a loss on the links' lengths; a chain of hard lengths
converges worse, as a vertex then drags all behind it. Each step is smoothed along the rope
(Nicolet, Jacobson and Jakob, Large Steps in Inverse Rendering of Geometry, 2021). At last the
vertices are projected to the nearest shape whose links are of equal length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera import Camera
from knotflow.perception.losses import (
    Target,
    bending_loss,
    depth_loss,
    length_loss,
    overlap_loss,
    silhouette_loss,
    table_loss,
)
from knotflow.perception.rendering import render
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
    """How far a vertex takes its neighbours along, links squared: without, vertices hardly slide
    along the rope to where its ends are seen."""
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

    def __post_init__(self) -> None:
        if self.steps < 1 or min(self.step_size, self.depth_scale, *self.softness) <= 0:
            raise ValueError(
                "a fit has at least one step, and its step size, softness and depth scale are "
                f"positive; got {self}"
            )


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


def misfit(
    shape: NDArray, target: Target, camera: Camera, rope: RopeConfig, config: FitConfig
) -> float:
    """How unlikely an image is if the rope lies in a shape (V, 3): the negative logarithm."""
    with torch.no_grad():
        loss = image_loss(torch.as_tensor(shape), target, camera, rope, config)
    return target.independent_pixels * float(loss)


def shape_loss(points: Tensor, rope: RopeConfig, config: FitConfig) -> Tensor:
    """How unlike a rope on a table a shape (..., V, 3) is, whatever the image."""
    return (
        config.length * length_loss(points, rope.link_length)
        + config.bending * bending_loss(points, rope.link_length)
        + config.table * table_loss(points, rope.radius)
        + config.overlap * overlap_loss(points, rope.radius)
    )


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
    guesses (B, V, 3) are fitted each by itself.

    A `prior` is a further loss of the shape, for what is known besides.
    """
    config = config or FitConfig()
    smooth = _smoothing(points.shape[-2], config.smoothing)
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


def _smoothing(vertices: int, amount: float) -> Tensor:
    """(V, V) by which steps are spread over neighbours: (1 + amount * Laplacian) inverse."""
    identity = torch.eye(vertices, dtype=torch.float64)
    differences = torch.diff(identity, dim=0)
    return torch.linalg.inv(identity + amount * differences.T @ differences)


def project_lengths(
    points: NDArray, link_length: float, mobility: NDArray | None = None
) -> NDArray[np.float64]:
    """The shape with links of equal length that is nearest to `points` (V, 3), metres.

    Newton's method on the constraints, each step the smallest that meets them to first order.
    Vertices move in proportion to their `mobility` (V,), positive; by default all alike.
    """
    shape = np.array(points, np.float64)
    ease = np.ones(len(shape)) if mobility is None else np.asarray(mobility, np.float64)
    for _ in range(50):
        span = np.diff(shape, axis=0)
        length = np.linalg.norm(span, axis=1)
        error = length - link_length
        if np.abs(error).max() < 1e-9 * link_length:
            break
        unit = span / np.maximum(length, 1e-12)[:, None]
        # J J^T, weighted by mobility, is tridiagonal: neighbours share a vertex.
        beside = -ease[1:-1] * (unit[1:] * unit[:-1]).sum(1)
        gram = np.diag(ease[1:] + ease[:-1]) + np.diag(beside, 1) + np.diag(beside, -1)
        pull = np.linalg.solve(gram, error)[:, None] * unit
        shape[:-1] += ease[:-1, None] * pull
        shape[1:] -= ease[1:, None] * pull
    return shape

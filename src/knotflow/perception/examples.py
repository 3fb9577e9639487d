"""Patches to train on, drawn from rope shapes by the thousand.

Neither camera nor colours are simulated: a rope is drawn straight into its patch, and what
segmentation and depth camera would have got wrong is added there. A patch takes about a
millisecond, a thirtieth of casting rays and segmenting.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from knotflow.perception.patch import HIGHEST, MARGIN, SMALLEST, on_plane
from knotflow.perception.training_config import ExamplesConfig


class Examples(NamedTuple):
    """`patches` (N, 3, S, S) as `Patch.crop` gives them, `nodes` (N, V, 3) as `Patch.from_world`,
    and `half` (N,), half the side of each patch in metres."""

    patches: Tensor
    nodes: Tensor
    half: Tensor


@torch.no_grad()
def draw(
    points: Tensor,
    radius: float,
    size: int,
    config: ExamplesConfig,
    generator: torch.Generator,
) -> Examples:
    """Examples of rope shapes (N, V, 3), metres, mirrored, turned and seen at random."""
    count, vertices, _ = points.shape
    length = float((points[0, 1:] - points[0, :-1]).norm(dim=-1).sum())

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=generator)

    def normal(std: float, *shape: int) -> Tensor:
        return std * torch.randn(count, *shape, generator=generator)

    rope = points - points.mean(dim=1, keepdim=True) * points.new_tensor([1.0, 1.0, 0.0])
    # A thicker rope is a higher one: z grows with the radius, x and y stay.
    thick = uniform(1 - config.scale, 1 + config.scale, 1)
    eye = torch.cat(
        [
            uniform(-config.aside, config.aside, 1, 2) * length,
            uniform(*config.distance, 1, 1) * length,
        ],
        dim=-1,
    )
    radii = rope[..., 2] / radius
    raised = torch.cat([rope[..., :2], (radii * radius * thick)[..., None]], dim=-1)
    places = on_plane(raised, eye, radius)  # (N, V, 2)
    middle = places.mean(dim=1, keepdim=True)
    _, axes = torch.linalg.eigh((places - middle).transpose(1, 2) @ (places - middle))
    axes = axes.flip(-1) @ _rotation(normal(config.turn))
    axes = axes * (2 * torch.randint(2, (count, 1, 2), generator=generator) - 1)
    along = (places - middle) @ axes
    low, high = along.amin(dim=1), along.amax(dim=1)
    half = 0.5 * MARGIN * (high - low).amax(dim=-1)
    half = half.clamp(min=0.5 * SMALLEST * length) * (1 + normal(config.shift).abs())
    shift = normal(config.shift, 1, 2)
    nodes = (along - 0.5 * (low + high)[:, None]) / half[:, None, None] + shift
    nodes = torch.cat([nodes, radii[..., None]], dim=-1)
    covered, top = rasterise(nodes, radius * thick[:, 0] / half, size)

    blurred = avg_pool2d(covered[:, None], 3, 1, 1, count_include_pad=True)[:, 0]
    covered = torch.lerp(covered, blurred, uniform(0, config.blur, 1, 1))
    covered = (0.5 + uniform(1, 1 + config.sharpen, 1, 1) * (covered - 0.5)).clamp(0, 1)
    top = top + uniform(0, config.noise, 1, 1) * normal(1.0, size, size)
    lost = uniform(0, 1, size, size) < uniform(0, config.lost, 1, 1)
    hidden = _hidden(size, uniform(-1, 1, 2), uniform(0.05, 0.25, 2), uniform(0, math.pi))
    hidden &= uniform(0, 1, 1, 1) < config.hidden
    covered = covered.masked_fill(hidden, 0.0)
    known = (~(hidden | lost)).float()
    raised = covered * top.clamp(0, HIGHEST)
    raised = torch.where(lost, avg_pool2d(raised[:, None], 3, 1, 1)[:, 0], raised)
    return Examples(torch.stack([covered, raised, known], dim=1), nodes, half)


def rasterise(nodes: Tensor, radius: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The rope's share of each pixel (N, S, S) and the height of its upper side there, radii.

    Args:
        nodes: (N, V, 3) places in the patch, -1..1, and heights of the axis, radii.
        radius: (N,) of the rope, half patches.
        size: pixels of the patch's side.
    """
    count = len(nodes)
    place = 0.5 * size * (nodes[..., :2] + 1) - 0.5  # pixels
    width = (0.5 * size * radius)[:, None, None, None]
    start, link = place[:, :-1], place[:, 1:] - place[:, :-1]  # (N, E, 2)
    low, rise = nodes[:, :-1, 2, None, None], (nodes[:, 1:, 2] - nodes[:, :-1, 2])[..., None, None]
    middle = (start + 0.5 * link).round()
    reach = math.ceil(float(0.5 * link.norm(dim=-1).max() + width.max()) + 1)
    step = torch.arange(-reach, reach + 1, dtype=place.dtype)
    x = middle[..., 0, None, None] + step  # (N, E, 1, W)
    y = middle[..., 1, None, None] + step[:, None]  # (N, E, W, 1)
    dx, dy = x - start[..., 0, None, None], y - start[..., 1, None, None]
    lx, ly = link[..., 0, None, None], link[..., 1, None, None]
    t = ((dx * lx + dy * ly) / (lx * lx + ly * ly).clamp(min=1e-9)).clamp(0, 1)
    apart = torch.hypot(dx - t * lx, dy - t * ly)
    share = (width - apart + 0.5).clamp(0, 1)
    top = low + t * rise + (1 - (apart / width).square()).clamp(min=0).sqrt()
    within = (x >= 0) & (x < size) & (y >= 0) & (y < size) & (share > 0)
    rope = torch.arange(count)[:, None, None, None]
    flat = (rope * size**2 + y * size + x).long()[within]
    covered = place.new_zeros(count * size**2).scatter_reduce_(0, flat, share[within], "amax")
    height = place.new_zeros(count * size**2).scatter_reduce_(0, flat, top[within], "amax")
    return covered.view(count, size, size), height.view(count, size, size)


def _rotation(angle: Tensor) -> Tensor:
    """Matrices (N, 2, 2) of angles (N,), radians."""
    cosine, sine = angle.cos(), angle.sin()
    return torch.stack([cosine, -sine, sine, cosine], dim=-1).view(-1, 2, 2)


def _hidden(size: int, middle: Tensor, extent: Tensor, angle: Tensor) -> Tensor:
    """Turned rectangles (N, S, S) bool of middles and half sides (N, 2), half patches."""
    grid = (torch.arange(size) + 0.5) * 2 / size - 1
    apart = torch.stack(torch.meshgrid(grid, grid, indexing="xy"), dim=-1)  # (S, S, 2)
    turned = (apart[None] - middle[:, None, None]) @ _rotation(angle)[:, None]
    return (turned.abs() < extent[:, None, None]).all(dim=-1)

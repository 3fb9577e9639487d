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

    def normal(std: float, *shape: int) -> Tensor:
        return std * torch.randn(count, *shape, generator=generator)

    places, thick = placed(points, radius, config, generator)
    radii = points[..., 2] / radius
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
    covered, top = rasterise(nodes, radius * thick / half, size)
    patches = seen_so(covered, top, config, generator)
    return Examples(patches, nodes, half)


@torch.no_grad()
def placed(
    points: Tensor, radius: float, config: ExamplesConfig, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Where a camera somewhere above sees rope shapes (N, V, 3), metres, on the plane z = radius.

    Returns:
        places (N, V, 2): metres.
        thick (N,): how thick each rope is against the one that its length is known for.
    """
    count = len(points)
    length = float((points[0, 1:] - points[0, :-1]).norm(dim=-1).sum())

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=generator)

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
    raised = torch.cat([rope[..., :2], (rope[..., 2] * thick)[..., None]], dim=-1)
    return on_plane(raised, eye, radius), thick[:, 0]


@torch.no_grad()
def seen_so(
    covered: Tensor, top: Tensor, config: ExamplesConfig, generator: torch.Generator
) -> Tensor:
    """What a camera would show (N, 3, S, S) of a rope's share and height (N, S, S) in each pixel,
    with what segmentation and depth get wrong; channels as those of `Patch.crop`."""
    count, size, _ = covered.shape

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=generator)

    blurred = avg_pool2d(covered[:, None], 3, 1, 1, count_include_pad=True)[:, 0]
    covered = torch.lerp(covered, blurred, uniform(0, config.blur, 1, 1))
    covered = (0.5 + uniform(1, 1 + config.sharpen, 1, 1) * (covered - 0.5)).clamp(0, 1)
    rough = uniform(0, config.noise, 1, 1)
    top = top + rough * torch.randn(count, size, size, generator=generator)
    lost = uniform(0, 1, size, size) < uniform(0, config.lost, 1, 1)
    hidden = _hidden(size, uniform(-1, 1, 2), uniform(0.05, 0.25, 2), uniform(0, math.pi))
    hidden &= uniform(0, 1, 1, 1) < config.hidden
    covered = covered.masked_fill(hidden, 0.0)
    known = (~(hidden | lost)).float()
    raised = covered * top.clamp(0, HIGHEST)
    raised = torch.where(lost, avg_pool2d(raised[:, None], 3, 1, 1)[:, 0], raised)
    return torch.stack([covered, raised, known], dim=1)


def rasterise(nodes: Tensor, radius: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The rope's share of each pixel (N, S, S) and the height of its upper side there, radii.

    Args:
        nodes: (N, V, 3) places in the patch, -1..1, and heights of the axis, radii.
        radius: (N,) of the rope, half patches.
        size: pixels of the patch's side.
    """
    count = len(nodes)
    place = 0.5 * size * (nodes[..., :2] + 1) - 0.5  # pixels
    width = (0.5 * size * radius)[:, None].expand(-1, nodes.shape[1] - 1)
    start, link = place[:, :-1], place[:, 1:] - place[:, :-1]  # (N, E, 2)
    middle = (start + 0.5 * link).round()
    reach = math.ceil(float(0.5 * link.norm(dim=-1).max() + width.max()) + 1)
    shown = ((middle > -reach) & (middle < size - 1 + reach)).all(dim=-1)
    rope = shown.nonzero()[:, 0, None, None]  # of L links

    def of(values: Tensor) -> Tensor:
        return values[shown][:, None, None]

    step = torch.arange(-reach, reach + 1, dtype=place.dtype)
    x = of(middle[..., 0]) + step  # (L, 1, W)
    y = of(middle[..., 1]) + step[:, None]  # (L, W, 1)
    dx, dy = x - of(start[..., 0]), y - of(start[..., 1])
    lx, ly = of(link[..., 0]), of(link[..., 1])
    t = ((dx * lx + dy * ly) / (lx * lx + ly * ly).clamp(min=1e-9)).clamp(0, 1)
    apart = torch.hypot(dx - t * lx, dy - t * ly)
    share = (of(width) - apart + 0.5).clamp(0, 1)
    low, rise = of(nodes[:, :-1, 2]), of(nodes[:, 1:, 2] - nodes[:, :-1, 2])
    top = low + t * rise + (1 - (apart / of(width)).square()).clamp(min=0).sqrt()
    within = (x >= 0) & (x < size) & (y >= 0) & (y < size) & (share > 0)
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

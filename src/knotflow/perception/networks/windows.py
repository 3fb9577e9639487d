"""What the network sees: windows along a rope's strands, of images, or drawn from shapes as
training examples with the errors of segmentation and depth camera.

A window is cut from a patch, a square of the plane through a flat rope's axis. A vertex is given by
the point of this plane that hides it from the camera, and its height, so that the network needs to
know neither the camera nor where on the table the rope lies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from torch import Tensor
from torch.nn.functional import avg_pool2d

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.evidence import Target
from knotflow.topology.polyline import Floats

SIDE = 48  # pixels of a window's side
HALF = 12.0  # half its side, radii of the rope
STEP = 2.0  # length of a step along a strand, radii
TRAIL = 12  # steps back that the window shows
HEADINGS = 32  # directions of a step that are distinguished,
WIDEST = 1.6  # up to this angle to either side, radians
_HIGHEST = 8.0  # heights above the table are cut here, radii of the rope
_ASIDE = 0.4  # standard deviation of a window's middle from the strand, along both axes, radii
_TURNED = 0.15  # standard deviation of its direction from the strand's, radians
_UNEVEN = 0.3  # standard deviation of the trail's points, along all axes, radii
_RAISED = 0.7  # standard deviation of all of its heights together, radii
_CUT = 0.2  # share of the trails that begin somewhere along the rope
_NEAR = 10.0  # radii from a crossing, at most, of the half of the windows that are near one


@dataclass(frozen=True, eq=False)
class Patch:
    """A square of the plane z = `radius`, the rope's, around `centre` (2,), along the world's axes,
    side 2 `half`, metres."""

    centre: Floats
    half: float
    radius: float

    def crop(self, target: Target, size: int) -> NDArray[np.float32]:
        """What the camera sees of the patch.

        Returns:
            (3, size, size), rows along y: the rope's share of each pixel, its
            height there in radii (0 where there is no rope), and how much is known.
        """
        seen, share = target.known.numpy(), target.coverage.numpy()
        deep = seen & np.isfinite(target.height.numpy())
        height = np.where(deep, target.height, 0.0) / self.radius
        fine = (np.arange(2 * size) + 0.5) / size - 1.0  # twice as fine, then averaged
        across, along = np.meshgrid(fine, fine, indexing="ij")
        places = self.centre + self.half * np.stack([along, across], axis=-1)
        world = np.concatenate([places, np.full_like(places[..., :1], self.radius)], axis=-1)
        column, row, _ = np.moveaxis(target.camera.project(world), -1, 0)
        at = np.nan_to_num(np.stack([row, column]), nan=-9.0)
        images = [
            map_coordinates(one.astype(np.float32), at, order=1, cval=0.0)
            for one in (share, share * deep, share * deep * height.clip(0.0, _HIGHEST), seen)
        ]
        covered, weight, raised, known = (
            one.reshape(size, 2, size, 2).mean(axis=(1, 3)) for one in images
        )
        raised = covered * raised / np.maximum(weight, 1e-3)
        return np.stack([covered, raised, known]).astype(np.float32)

    def to_world(self, nodes: NDArray, camera: Camera) -> Floats:
        """Points (V, 3), metres, of nodes (V, 3): place in the patch, -1..1, and height, radii."""
        eye = camera.position
        places = self.centre + self.half * nodes[:, :2]
        height = self.radius * nodes[:, 2:]
        reach = (eye[2] - height) / (eye[2] - self.radius)
        return np.concatenate([eye[:2] + (places - eye[:2]) * reach, height], axis=1)


def project_to_plane(points: Tensor, eye: Tensor, radius: float | Tensor) -> Tensor:
    """The places (..., 2) of the plane z = radius that an eye (..., 3) sees points (..., 3) at."""
    reach = (eye[..., 2:] - radius) / (eye[..., 2:] - points[..., 2:])
    return eye[..., :2] + (points[..., :2] - eye[..., :2]) * reach


def rasterise(nodes: Tensor, radius: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The rope's share of each pixel (N, S, S) and the height of its upper side there, radii, from
    `nodes` (N, V, 3): places in the patch, -1..1, and heights of the axis, radii. The rope's
    `radius` (N,) is in half patches."""
    count = len(nodes)
    place = 0.5 * size * (nodes[..., :2] + 1) - 0.5  # pixels
    width = (0.5 * size * radius)[:, None].expand(-1, nodes.shape[1] - 1)
    start, link = place[:, :-1], place[:, 1:] - place[:, :-1]  # (N, E, 2)
    middle = (start + 0.5 * link).round()
    reach = math.ceil(float(0.5 * link.norm(dim=-1).max() + width.max()) + 1)
    inside = ((middle > -reach) & (middle < size - 1 + reach)).all(dim=-1)
    rope = inside.nonzero()[:, 0, None, None]  # of L links

    def of(values: Tensor) -> Tensor:
        return values[inside][:, None, None]

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


def to_window(
    points: Tensor, middle: Tensor, angle: Tensor, mirror: Tensor | None = None
) -> Tensor:
    """Points (N, K, 3), radii, in windows around `middle` (N, 2): places in units of HALF, the
    first axis at an `angle` (N,), radians, the second times `mirror` (N,); heights as they were."""
    cosine, sine = angle.cos()[:, None], angle.sin()[:, None]
    x, y = (points[..., :2] - middle[:, None]).unbind(-1)
    first, second = cosine * x + sine * y, cosine * y - sine * x
    if mirror is not None:
        second = second * mirror[:, None]
    return torch.stack([first / HALF, second / HALF, points[..., 2]], dim=-1)


def with_trail(seen: Tensor, trail: Tensor) -> Tensor:
    """Windows (N, 5, SIDE, SIDE) of what is seen (N, 3, SIDE, SIDE) and a trail (N, K, 3)."""
    thin = trail.new_full((len(trail),), 0.7 / HALF)
    covered, top = rasterise(trail, thin, SIDE)
    return torch.cat([seen, covered[:, None], (covered * top)[:, None]], dim=1)


@dataclass
class ExamplesConfig:
    """How much examples differ from the shapes they are drawn from; uniform unless said."""

    scale: float = 0.1  # largest relative change of the rope's thickness against its length
    distance: tuple[float, float] = (0.8, 1.6)  # camera's height above the table, rope lengths
    aside: float = 0.5  # farthest that it lies from below the camera in x and y, rope lengths
    noise: float = 0.6  # largest standard deviation of a height, radii
    blur: float = 0.7  # largest part of a pixel's share of rope that is of the 3 x 3 around it
    sharpen: float = 1.5  # largest steepening of that share, which a mask has
    lost: float = 0.1  # largest share of pixels without depth
    hidden: float = 0.3  # probability that something hides a piece of the patch


class _Draw(NamedTuple):
    """Random numbers (N, ...)."""

    number: int
    generator: torch.Generator

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(self.number, *shape, generator=self.generator)

    def normal(self, std: float, *shape: int) -> Tensor:
        return std * torch.randn(self.number, *shape, generator=self.generator)


class Windows(NamedTuple):
    """`windows` (N, 5, SIDE, SIDE) and `height` (N,), radii, as `StrandNetwork` takes them; the
    `heading` (N,) of the next step, index; `next_height` (N,), radii; `end` (N,) bool, whether the
    rope ends before."""

    windows: Tensor
    height: Tensor
    heading: Tensor
    next_height: Tensor
    end: Tensor


@torch.no_grad()
def draw_windows(
    points: Tensor, radii: Tensor, config: ExamplesConfig, generator: torch.Generator
) -> Windows:
    """A window somewhere along each of the rope shapes (N, V, 3) of `radii` (N,), metres, seen at
    random."""
    count, vertices, _ = points.shape
    links, draw = vertices - 1, _Draw(count, generator)
    places, thick = _view_at_random(points, radii, config, draw)
    ropes = torch.cat([places, points[..., 2:]], dim=-1) / radii[:, None, None]
    link = (ropes[:, 1:] - ropes[:, :-1]).norm(dim=-1).mean(dim=1)  # (N,) radii
    step, backward = STEP / link, draw.uniform(0, 1) < 0.5
    ropes = torch.where(backward[:, None, None], ropes.flip(1), ropes)

    at = draw.uniform(0, links)
    rope, over, under = find_crossings(ropes)
    chosen = torch.randperm(2 * len(rope), generator=generator)
    near = at.clone()
    near[rope.repeat(2)[chosen]] = torch.cat([over, under])[chosen]
    near = (near + draw.uniform(-_NEAR, _NEAR) / link).clamp(0, links)
    at = torch.where(draw.uniform(0, 1) < 0.5, near, at)

    here, following = points_at(ropes, at), points_at(ropes, at + step)
    tangent = (points_at(ropes, at + 0.3) - points_at(ropes, at - 0.3))[:, :2]
    angle = torch.atan2(tangent[:, 1], tangent[:, 0]) + draw.normal(_TURNED)
    middle = here[:, :2] + draw.normal(_ASIDE, 2)
    mirror = torch.where(draw.uniform(0, 1) < 0.5, 1.0, -1.0)
    begun = torch.where(draw.uniform(0, 1) < _CUT, draw.uniform(0, TRAIL), float(TRAIL))
    steps = step[:, None] * torch.minimum(torch.arange(TRAIL + 1), begun[:, None])
    trail = points_at(ropes, (at[:, None] - steps).clamp(min=0))
    trail = trail + draw.normal(_UNEVEN, 1, 3) + draw.normal(_UNEVEN, TRAIL + 1, 3)
    raised = draw.normal(_RAISED)
    trail[:, 0, :2], trail[..., 2] = middle, (trail[..., 2] + raised[:, None]).clamp(min=1)
    height = (here[:, 2] + raised + draw.normal(_UNEVEN)).clamp(min=1)

    frame = middle, angle, mirror
    covered, top = rasterise(to_window(ropes, *frame), thick / HALF, SIDE)
    seen = _degrade(covered, top, config, draw)
    window = with_trail(seen, to_window(trail, *frame))
    onward = to_window(following[:, None], *frame)[:, 0]
    heading = torch.atan2(onward[:, 1], onward[:, 0])
    index = ((heading + WIDEST) * (HEADINGS / (2 * WIDEST))).floor().long().clamp(0, HEADINGS - 1)
    return Windows(window, height, index, following[:, 2], at + step > links)


def _view_at_random(
    points: Tensor, radii: Tensor, config: ExamplesConfig, draw: _Draw
) -> tuple[Tensor, Tensor]:
    """Where a camera somewhere above sees rope shapes (N, V, 3) of `radii` (N,), metres, on the
    plane of their axes.

    Returns:
        places (N, V, 2): metres.
        thick (N,): how thick each rope is against the one that its length is known for.
    """
    length = (points[:, 1:] - points[:, :-1]).norm(dim=-1).sum(dim=1)[:, None, None]
    rope = points - points.mean(dim=1, keepdim=True) * points.new_tensor([1.0, 1.0, 0.0])
    # A thicker rope is a higher one: z grows with the radius, x and y stay.
    thick = draw.uniform(1 - config.scale, 1 + config.scale, 1)
    aside = draw.uniform(-config.aside, config.aside, 1, 2) * length
    eye = torch.cat([aside, draw.uniform(*config.distance, 1, 1) * length], dim=-1)
    raised = torch.cat([rope[..., :2], (rope[..., 2] * thick)[..., None]], dim=-1)
    return project_to_plane(raised, eye, radii[:, None, None]), thick[:, 0]


def _degrade(covered: Tensor, top: Tensor, config: ExamplesConfig, draw: _Draw) -> Tensor:
    """A crop, see `Patch.crop`, of a rope's share and height (N, S, S), with a camera's errors."""
    size = covered.shape[-1]
    blurred = avg_pool2d(covered[:, None], 3, 1, 1, count_include_pad=True)[:, 0]
    covered = torch.lerp(covered, blurred, draw.uniform(0, config.blur, 1, 1))
    covered = (0.5 + draw.uniform(1, 1 + config.sharpen, 1, 1) * (covered - 0.5)).clamp(0, 1)
    rough = draw.uniform(0, config.noise, 1, 1)
    top = top + rough * draw.normal(1.0, size, size)
    lost = draw.uniform(0, 1, size, size) < draw.uniform(0, config.lost, 1, 1)
    hidden = _rectangles(
        size, draw.uniform(-1, 1, 2), draw.uniform(0.05, 0.25, 2), draw.uniform(0, math.pi)
    )
    hidden &= draw.uniform(0, 1, 1, 1) < config.hidden
    covered = covered.masked_fill(hidden, 0.0)
    known = (~(hidden | lost)).float()
    raised = covered * top.clamp(0, _HIGHEST)
    raised = torch.where(lost, avg_pool2d(raised[:, None], 3, 1, 1)[:, 0], raised)
    return torch.stack([covered, raised, known], dim=1)


def points_at(ropes: Tensor, at: Tensor) -> Tensor:
    """Points of ropes (N, V, C) at places (N,) or (N, M) along them, 0..V-1, cut to their ends."""
    last = ropes.shape[1] - 1
    flat = (at if at.ndim > 1 else at[:, None]).clamp(0, last)
    before = flat.floor().long().clamp(max=last - 1)
    share = (flat - before)[..., None]
    index = before[..., None].expand(-1, -1, ropes.shape[2])
    found = (1 - share) * ropes.gather(1, index) + share * ropes.gather(1, index + 1)
    return found.reshape(*at.shape, ropes.shape[2])


def find_crossings(ropes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where ropes (N, V, 3) cross themselves in the plane: for each of C crossings of all the rope
    (C,), and where along it, 0..V-1, the upper and the lower strand (C,) are."""
    links = ropes.shape[1] - 1
    one, other = torch.triu_indices(links, links, offset=2)
    start, link = ropes[:, :-1, :2], ropes[:, 1:, :2] - ropes[:, :-1, :2]
    p, d = start[:, one], link[:, one]
    q, e = start[:, other], link[:, other]
    apart, turn = q - p, _cross(d, e)
    safe = torch.where(turn.abs() < 1e-12, torch.full_like(turn, 1e-12), turn)
    s, t = _cross(apart, e) / safe, _cross(apart, d) / safe
    rope, pair = torch.nonzero((s >= 0) & (s < 1) & (t >= 0) & (t < 1), as_tuple=True)
    first = one[pair] + s[rope, pair]
    second = other[pair] + t[rope, pair]
    swapped = points_at(ropes[rope], first)[:, 2] < points_at(ropes[rope], second)[:, 2]
    return rope, torch.where(swapped, second, first), torch.where(swapped, first, second)


def _cross(one: Tensor, other: Tensor) -> Tensor:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]


def _rectangles(size: int, middle: Tensor, extent: Tensor, angle: Tensor) -> Tensor:
    """Rectangles (N, S, S) bool of middles and half sides (N, 2), half patches, turned by angles
    (N,), radians."""
    grid = (torch.arange(size) + 0.5) * 2 / size - 1
    apart = torch.stack(torch.meshgrid(grid, grid, indexing="xy"), dim=-1)  # (S, S, 2)
    cosine, sine = angle.cos(), angle.sin()
    turn = torch.stack([cosine, -sine, sine, cosine], dim=-1).view(-1, 1, 2, 2)
    turned = (apart - middle[:, None, None]) @ turn
    return (turned.abs() < extent[:, None, None]).all(dim=-1)

"""Paths along which the rope of an image may run: a beam search over a strand network's steps, from
places on the rope to its ends and from these ends again (Sec. VI)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.chain import project_lengths
from knotflow.perception.estimation.segmentation import Segmentation
from knotflow.perception.networks.examples import to_window, with_trail
from knotflow.perception.networks.models import (
    HALF,
    SIDE,
    STEP,
    TRAIL,
    StrandNetwork,
    headings,
)
from knotflow.perception.networks.patches import Patch
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread

PIXEL = 2 * HALF / SIDE
"""Side of a map's pixel, radii."""
BEAM = 16
"""Paths followed at once from an end of the rope,"""
HALVES = 8
"""and from a place between its ends."""
JOINED = 4
"""Pairs of these that are paths from end to end, most."""
ENDS = 4
"""Ends of such pairs from which the rope is followed again, most."""
SEEDS = 2
"""Places on the rope at which it is begun."""
MODES = 3
"""Ways on from one place, at most."""
UNLIKELY = 0.03
"""A way on is not followed if it is less probable."""
MODE = 3
"""Headings to either side that belong to a mode."""
SHORTEST, LONGEST = 0.85, 1.15
"""A shorter or longer path is none, rope lengths."""
ALONG_ITSELF = 4
"""Steps, one after the other, along which a path may touch itself,"""
OVERLAP = 0.9
"""nearer than this in the plane, radii;"""
APART = 8.0
"""what is nearer along the path does not count, radii."""
ALIKE = 0.7
"""Paths whose last points are nearer to each other are compared, radii; of two that are everywhere
nearer than this in their mean, one is kept."""
LENGTH_OFF = 20.0
"""What is taken from a path's logarithm of probability for each rope length that it is too long or
too short."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StrandPath:
    """A strand followed so far."""

    points: Floats
    """(K, 3) place on the map's plane and height, radii."""
    probability: Floats
    """(K,) of each step; 1 for the first point."""
    direction: float
    """Of the last step, radians."""
    along: int = 0
    """Steps, up to the last, for which it has run along itself."""
    ended: bool = False
    """Whether the rope ends there."""

    @classmethod
    def begun(cls, place: NDArray, direction: float) -> StrandPath:
        """At a place (3,)."""
        return cls(place[None], np.ones(1), direction)

    @property
    def length(self) -> float:
        """In the plane, radii."""
        return STEP * (len(self.points) - 1)

    @property
    def likelihood(self) -> float:
        """Logarithm of the path's probability."""
        return float(np.log(self.probability).sum())

    def joined(self, other: StrandPath) -> StrandPath:
        """From this path's end back to its beginning, and on along another that begins there."""
        points = np.concatenate([self.points[:0:-1], other.points])
        probability = np.concatenate([self.probability[:0:-1], other.probability])
        return replace(other, points=points, probability=probability)


def trace_rope(
    network: StrandNetwork,
    segmentation: Segmentation,
    share: NDArray,
    camera: Camera,
    rope: RopeConfig,
) -> list[Floats]:
    """Shapes (V, 3), metres, from either end, that the rope of an image may have, the likeliest
    first; none where none is found. The rope's `share` (H, W) of each pixel is 0..1."""
    places = camera.on_plane(segmentation.rope, rope.radius)
    if len(places) < 2:
        return []
    low, high = places.min(axis=0), places.max(axis=0)
    size = int(np.ceil((float((high - low).max()) / rope.radius + 2 * HALF) / PIXEL))
    half = size * PIXEL * rope.radius / 2
    patch = Patch(0.5 * (low + high), np.eye(2), half, rope.radius)
    seen = torch.as_tensor(patch.crop(segmentation, share, camera, size))
    even = np.linspace(0, 1, rope.num_vertices)
    found = []
    for path in trace_strands(network, seen, rope.length / rope.radius):
        nodes = path.points * [rope.radius / half, rope.radius / half, 1.0]
        world = patch.to_world(nodes, camera)
        along = np.r_[0.0, np.linalg.norm(np.diff(world, axis=0), axis=1).cumsum()]
        along /= along[-1]
        shape = np.stack([np.interp(even, along, world[:, k]) for k in range(3)], axis=1)
        found.append(project_lengths(shape, rope.link_length))
    return found


@one_thread()
@torch.inference_mode()
def trace_strands(network: StrandNetwork, seen: Tensor, length: float) -> list[StrandPath]:
    """Paths along a rope of a `length`, radii, in a map of the table (3, S, S), see `Patch.crop`, a
    pixel PIXEL radii, from either end, the likeliest first; none where none is found."""
    network.eval()

    def badness(path: StrandPath) -> float:
        return LENGTH_OFF * abs(path.length / length - 1) - path.likelihood

    halves = [
        StrandPath.begun(np.r_[place, 1.0], direction + turn)
        for place, direction in _seeds(seen)
        for turn in (0.0, np.pi)
    ]
    followed = _follow(network, seen, halves, length, HALVES)
    found: list[StrandPath] = []
    for one_way, other_way in zip(followed[::2], followed[1::2], strict=True):
        joined = [one.joined(other) for one in one_way for other in other_way]
        found += sorted((path for path in joined if path.length), key=badness)[:JOINED]
    ends: list[StrandPath] = []
    for path in sorted(found, key=badness):
        for last, before in (path.points[:2], path.points[:-3:-1]):
            apart = [np.hypot(*(last - other.points[0])[:2]) for other in ends]
            if len(ends) < ENDS and min(apart, default=np.inf) > 2 * STEP:
                back = before - last
                ends.append(StrandPath.begun(last, float(np.arctan2(back[1], back[0]))))
    for paths in _follow(network, seen, ends, length, BEAM, SHORTEST * length):
        found += paths
    whole = [one for one in found if SHORTEST <= one.length / length <= LONGEST]
    return sorted(whole, key=badness)


def _seeds(seen: Tensor) -> list[tuple[Floats, float]]:
    """Places (2,), radii, far apart, where one strand is seen alone, and its direction."""
    from scipy import ndimage

    covered, raised = seen[0].numpy(), seen[1].numpy()
    flat = (covered > 0.5) & (raised < 2.8)
    size = len(covered)
    reach = round(2.0 * STEP / PIXEL)
    mass = ndimage.uniform_filter(covered, 2 * reach + 1)
    rows, columns = np.nonzero(flat)
    order = np.argsort(mass[rows, columns])
    chosen: list[tuple[Floats, float]] = []
    for index in order[len(order) // 4 :]:  # where least is seen, the rope ends
        row, column = rows[index], columns[index]
        place = (np.array([column, row]) + 0.5 - size / 2) * PIXEL
        if all(np.hypot(*(place - other)) > 10 * STEP for other, _ in chosen):
            window = covered[
                max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1
            ]
            v, u = np.nonzero(window > 0.5)
            if len(u) < 3:
                continue
            _, axes = np.linalg.eigh(np.cov(np.stack([u, v])))
            chosen.append((place, float(np.arctan2(axes[1, 1], axes[0, 1]))))
        if len(chosen) == SEEDS:
            break
    return chosen


def _follow(
    network: StrandNetwork,
    seen: Tensor,
    begun: list[StrandPath],
    length: float,
    beam: int,
    least: float = 0.0,
) -> list[list[StrandPath]]:
    """Each path followed to its ends, the likeliest first. No rope ends before it is `least` long:
    a strand that goes on below others is easily taken for an end."""
    done: list[list[StrandPath]] = [[] for _ in begun]
    growing = [[path] for path in begun]
    while any(growing):
        onward = iter(_grown(network, seen, [path for paths in growing for path in paths], least))
        for number, paths in enumerate(growing):
            more = [one for _ in paths for one in next(onward)]
            growing[number] = []
            for one in sorted(more, key=lambda path: -path.likelihood):
                if one.ended or one.length + STEP > LONGEST * length:
                    done[number].append(one)
                elif len(growing[number]) < beam and not any(
                    _alike(one, other) for other in growing[number]
                ):
                    growing[number].append(one)
    return [sorted(paths, key=lambda path: -path.likelihood)[:beam] for paths in done]


def _grown(
    network: StrandNetwork, seen: Tensor, paths: list[StrandPath], least: float
) -> list[list[StrandPath]]:
    """The ways on from each path."""
    found = network(_windows(seen, paths), _tensor([path.points[-1, 2] for path in paths]))
    shares, ends = found.heading.exp().numpy(), torch.sigmoid(found.end).numpy()
    angles, heights = headings().numpy(), found.height.clamp(min=1.0).numpy()
    grown: list[list[StrandPath]] = []
    for path, share, height, end in zip(paths, shares, heights, ends, strict=True):
        grown.append([])
        if path.length < least:
            end = 0.0
        if end > UNLIKELY:
            probability = np.append(path.probability[:-1], path.probability[-1] * end)
            grown[-1].append(replace(path, probability=probability, ended=True))
        for heading, mass in _modes(share, angles) if end < 1 - UNLIKELY else []:
            direction = path.direction + heading
            step = STEP * np.array([np.cos(direction), np.sin(direction)])
            place = path.points[-1, :2] + step
            old = path.points[: -round(APART / STEP), :2]
            touches = len(old) and np.hypot(*(old - place).T).min() < OVERLAP
            along = path.along + 1 if touches else 0
            if along <= ALONG_ITSELF:
                points = np.concatenate([path.points, np.append(place, height)[None]])
                probability = np.append(path.probability, mass * (1 - end))
                grown[-1].append(StrandPath(points, probability, float(direction), along))
    return grown


def _modes(shares: NDArray, angles: NDArray) -> list[tuple[float, float]]:
    """The likely headings and how likely each is, from probabilities (HEADINGS,)."""
    left, found = shares.copy(), []
    for _ in range(MODES):
        peak = int(left.argmax())
        part = slice(max(0, peak - MODE), peak + MODE + 1)
        mass = float(left[part].sum())
        if mass < UNLIKELY:
            break
        found.append((float((left[part] * angles[part]).sum() / mass), mass))
        left[part] = 0.0
    return found


def _windows(seen: Tensor, paths: list[StrandPath]) -> Tensor:
    """Windows (N, 5, SIDE, SIDE) around the ends of paths, turned along them."""
    middle = _tensor([path.points[-1, :2] for path in paths])
    angle = _tensor([path.direction for path in paths])
    grid = (torch.arange(SIDE) + 0.5) * PIXEL - HALF
    across, along = torch.meshgrid(grid, grid, indexing="ij")
    cosine, sine = angle.cos()[:, None, None], angle.sin()[:, None, None]
    x = middle[:, 0, None, None] + cosine * along - sine * across
    y = middle[:, 1, None, None] + sine * along + cosine * across
    size = seen.shape[-1] * PIXEL / 2
    places = torch.stack([x, y], dim=-1) / size
    windows = grid_sample(
        seen.expand(len(paths), -1, -1, -1), places, padding_mode="border", align_corners=False
    )
    trails = [path.points[::-1][: TRAIL + 1] for path in paths]  # newest first
    # A short trail repeats its first point.
    last = _tensor([one[np.minimum(np.arange(TRAIL + 1), len(one) - 1)] for one in trails])
    return with_trail(windows, to_window(last, middle, angle))


def _alike(one: StrandPath, other: StrandPath) -> bool:
    """Whether two paths of the same beginning and number of steps are nearly the same."""
    if np.hypot(*(one.points[-1] - other.points[-1])[:2]) > ALIKE:
        return False
    apart = np.abs(one.points - other.points)
    return bool(np.hypot(*apart[:, :2].T).mean() < ALIKE and apart[:, 2].max() < 1.0)


def _tensor(values: object) -> Tensor:
    return torch.as_tensor(np.asarray(values), dtype=torch.float32)

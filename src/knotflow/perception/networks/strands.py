"""Paths along which the rope of an image may run: a beam search over a network's steps along a
strand, from places on the rope to its ends and from these ends again (Sec. VI).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage
from torch import Tensor
from torch.nn.functional import grid_sample

from knotflow.perception.estimation.evidence import Target
from knotflow.perception.estimation.fitting import project_lengths
from knotflow.perception.networks.network import StrandNetwork
from knotflow.perception.networks.windows import (
    HALF,
    HEADINGS,
    SIDE,
    STEP,
    TRAIL,
    WIDEST,
    Patch,
    to_window,
    with_trail,
)
from knotflow.threads import one_thread
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

PIXEL = 2 * HALF / SIDE  # side of a map's pixel, radii
_BEAM, _HALVES = 16, 8  # paths followed at once from an end of the rope, and from elsewhere
_JOINED = 4  # pairs of the latter that are paths from end to end, most
_ENDS = 4  # ends of such pairs from which the rope is followed again, most
_SEEDS = 2  # places on the rope at which it is begun
_MODES, _MODE = 3, 3  # ways on from one place, at most; headings to either side that belong to one
_UNLIKELY = 0.03  # a way on is not followed if it is less probable
_SHORTEST, _LONGEST = 0.85, 1.15  # lengths of a path, rope lengths
_ALONG_ITSELF = 4  # steps, one after the other, along which a path may touch itself,
_OVERLAP = 0.9  # nearer than this in the plane, radii;
_APART = 8.0  # what is nearer along the path does not count, radii
_ALIKE = 0.7  # radii: of two paths whose last points and mean are nearer than this, one is kept
_LENGTH_OFF = 20.0  # taken from a log likelihood for each rope length too long or too short


@dataclass(frozen=True, eq=False)
class StrandPath:
    """A strand followed so far."""

    points: Floats  # (K, 3) place on the map's plane and height, radii
    probability: Floats  # (K,) of each step; 1 for the first point
    direction: float  # of the last step, radians
    along: int = 0  # steps, up to the last, for which it has run along itself
    ended: bool = False  # whether the rope ends there

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


def trace_rope(network: StrandNetwork, target: Target) -> list[Floats]:
    """Shapes (V, 3), metres, from either end, that an image's rope may have, likeliest first."""
    camera, rope = target.camera, target.rope
    places = camera.on_plane(target.mask.numpy(), rope.radius)
    if len(places) < 2:
        return []
    low, high = places.min(axis=0), places.max(axis=0)
    size = int(np.ceil((float((high - low).max()) / rope.radius + 2 * HALF) / PIXEL))
    half = size * PIXEL * rope.radius / 2
    patch = Patch(0.5 * (low + high), half, rope.radius)
    seen = torch.as_tensor(patch.crop(target, size))
    even = np.linspace(0, 1, rope.num_vertices)
    found = []
    for path in trace_strands(network, seen, rope.length / rope.radius):
        nodes = path.points * [rope.radius / half, rope.radius / half, 1.0]
        world = patch.to_world(nodes, camera)
        along = arc_lengths(world)
        shape = interpolate(even, along / along[-1], world)
        found.append(project_lengths(shape, rope.link_length))
    return found


@one_thread()
@torch.inference_mode()
def trace_strands(network: StrandNetwork, seen: Tensor, length: float) -> list[StrandPath]:
    """Paths along a rope of a `length`, radii, in a map of the table (3, S, S), see `Patch.crop`, a
    pixel PIXEL radii, from either end, the likeliest first; none where none is found."""
    network.eval()

    def badness(path: StrandPath) -> float:
        return _LENGTH_OFF * abs(path.length / length - 1) - path.likelihood

    halves = [
        StrandPath(np.array([[*place, 1.0]]), np.ones(1), direction + turn)
        for place, direction in _seeds(seen)
        for turn in (0.0, np.pi)
    ]
    followed = _follow(network, seen, halves, length, _HALVES)
    found: list[StrandPath] = []
    for one_way, other_way in zip(followed[::2], followed[1::2], strict=True):
        joined = [one.joined(other) for one in one_way for other in other_way]
        found += sorted((path for path in joined if path.length), key=badness)[:_JOINED]
    ends: list[StrandPath] = []
    for path in sorted(found, key=badness):
        for last, before in (path.points[:2], path.points[:-3:-1]):
            apart = [np.hypot(*(last - other.points[0])[:2]) for other in ends]
            if len(ends) < _ENDS and min(apart, default=np.inf) > 2 * STEP:
                x, y, _ = before - last
                ends.append(StrandPath(last[None], np.ones(1), float(np.arctan2(y, x))))
    for paths in _follow(network, seen, ends, length, _BEAM, _SHORTEST * length):
        found += paths
    whole = [one for one in found if _SHORTEST <= one.length / length <= _LONGEST]
    return sorted(whole, key=badness)


def _seeds(seen: Tensor) -> list[tuple[Floats, float]]:
    """Places (2,), radii, far apart, where one strand is seen alone, and its direction."""
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
        if len(chosen) == _SEEDS:
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
                if one.ended or one.length + STEP > _LONGEST * length:
                    done[number].append(one)
                elif len(growing[number]) < beam and not any(
                    _alike(one, other) for other in growing[number]
                ):
                    growing[number].append(one)
    return [sorted(paths, key=lambda path: -path.likelihood)[:beam] for paths in done]


def _grown(
    network: StrandNetwork, seen: Tensor, paths: list[StrandPath], least: float
) -> list[list[StrandPath]]:
    found = network(_windows(seen, paths), _tensor([path.points[-1, 2] for path in paths]))
    shares, ends = found.heading.exp().numpy(), torch.sigmoid(found.end).numpy()
    angles, heights = headings().numpy(), found.height.clamp(min=1.0).numpy()
    grown: list[list[StrandPath]] = []
    for path, share, height, end in zip(paths, shares, heights, ends, strict=True):
        grown.append([])
        if path.length < least:
            end = 0.0
        if end > _UNLIKELY:
            probability = np.append(path.probability[:-1], path.probability[-1] * end)
            grown[-1].append(replace(path, probability=probability, ended=True))
        for heading, mass in _modes(share, angles) if end < 1 - _UNLIKELY else []:
            direction = path.direction + heading
            step = STEP * np.array([np.cos(direction), np.sin(direction)])
            place = path.points[-1, :2] + step
            old = path.points[: -round(_APART / STEP), :2]
            touches = len(old) and np.hypot(*(old - place).T).min() < _OVERLAP
            along = path.along + 1 if touches else 0
            if along <= _ALONG_ITSELF:
                points = np.concatenate([path.points, np.append(place, height)[None]])
                probability = np.append(path.probability, mass * (1 - end))
                grown[-1].append(StrandPath(points, probability, float(direction), along))
    return grown


def headings() -> Tensor:
    """The middle (HEADINGS,) of each direction, radians."""
    return (torch.arange(HEADINGS) + 0.5) * (2 * WIDEST / HEADINGS) - WIDEST


def _modes(shares: NDArray, angles: NDArray) -> list[tuple[float, float]]:
    """The likely headings and how likely each is, from probabilities (HEADINGS,)."""
    left, found = shares.copy(), []
    for _ in range(_MODES):
        peak = int(left.argmax())
        part = slice(max(0, peak - _MODE), peak + _MODE + 1)
        mass = float(left[part].sum())
        if mass < _UNLIKELY:
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
    if np.hypot(*(one.points[-1] - other.points[-1])[:2]) > _ALIKE:
        return False
    apart = np.abs(one.points - other.points)
    return bool(np.hypot(*apart[:, :2].T).mean() < _ALIKE and apart[:, 2].max() < 1.0)


def _tensor(values: object) -> Tensor:
    return torch.as_tensor(np.asarray(values), dtype=torch.float32)

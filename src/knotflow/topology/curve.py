"""From a rope's shape to its crossings and segments (paper Sec. IV, Eq. 1).

The rope is a polyline, points (V, 3) in metres, head first, projected along z onto the table. The
order in which it meets its crossings, their signs and which strand is higher are the signed Gauss
code.

A degenerate projection (a vertex on another strand, strands on top of each other, three strands
through one point, upright links) is perturbed: upright links are laid down, and the vertices moved
in fixed pseudo-random directions. Where all neighbours have the same crossings, these are taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from knotflow.arrays import floats
from knotflow.topology.planar_map import Crossing
from knotflow.topology.polyline import (
    COINCIDENCE,
    DegenerateCurveError,
    Floats,
    PlanarCrossings,
    arc_lengths,
    planar_crossings,
)

DEFAULT_MIN_GAP, SHORT_MIN_GAP = 1e-3, 2e-3
"""Strands of a crossing that are closer in height, metres, pass through each other; of ropes below
half a metre, relative to their length."""
FARTHEST = 1e9
"""Metres from the origin to a vertex; far beyond, squares of lengths overflow."""

_NUDGE = 1e-7  # of the rope's length: sideways perturbation of a degenerate projection
_NUDGED_PAIRS = 16
_PARTING = 1e-5  # of the rope's length: well above the nudges


@dataclass(frozen=True, eq=False)
class CurveCrossings:
    """The crossings of a projected rope, as of a `TopologicalState`, and their 2c positions.

    Attributes:
        fractions: (2c,) where each position is met, as a fraction (0 head, 1 tail) of the rope's
            length in space; ascending.
        xy: (2c, 2) world frame, metres; the two positions of a crossing share their xy.
        heights: (2c,) z of the rope there, metres.
    """

    crossings: tuple[Crossing, ...]
    fractions: Floats
    xy: Floats
    heights: Floats

    @property
    def segment_intervals(self) -> Floats:
        """(2c + 1, 2) begin and end of each segment, as fractions of the rope's length."""
        bounds = np.concatenate(([0.0], self.fractions, [1.0]))
        return np.stack((bounds[:-1], bounds[1:]), axis=1)


def project(points: ArrayLike, min_gap: float | None = None) -> CurveCrossings:
    """The crossings of a rope (V, 3), metres, head first, z up, projected onto the table.

    Raises:
        DegenerateCurveError: the projection does not determine the state, or strands are closer in
            height than `min_gap` metres, see `DEFAULT_MIN_GAP`; says where on the rope.
        ValueError: not finite (V, 3) numbers.
    """
    rope = as_rope(points)
    reached = arc_lengths(rope)
    if reached[-1] == 0.0:
        raise DegenerateCurveError("all vertices of the rope are at one point")
    if min_gap is None:
        min_gap = min(DEFAULT_MIN_GAP, SHORT_MIN_GAP * float(reached[-1]))
    fractions = reached / reached[-1]
    planar = planar_crossings(rope[:, :2])
    if not planar.degenerate:
        return _with_heights(rope, fractions, planar, min_gap)

    extent = float(np.abs(np.diff(rope, axis=0)).sum())
    results = []
    for parted in (_part_upright(rope, _PARTING * extent, ahead) for ahead in (True, False)):
        for nudge in _nudges(len(rope)):
            nudged = parted.copy()
            nudged[:, :2] += _NUDGE * extent * nudge
            neighbour = planar_crossings(nudged[:, :2])
            results.append(_with_heights(nudged, fractions, neighbour, min_gap))
    codes = list(dict.fromkeys(result.crossings for result in results))
    if len(codes) > 1:
        raise DegenerateCurveError(
            f"the projected rope is degenerate: {planar.degenerate}; moving its vertices by "
            f"{_NUDGE * extent:.0e} m gives {len(codes)} different states, of "
            f"{' or '.join(map(str, sorted({len(code) for code in codes})))} crossings"
        )
    return results[0]


def segment_intervals(points: ArrayLike) -> Floats:
    """Begin and end of each segment, (num_segments, 2) fractions of the length; see `project`."""
    return project(points).segment_intervals


def segment_lengths(points: ArrayLike) -> Floats:
    """Length of each segment, (num_segments,) fractions of the rope's length; see `project`."""
    return np.diff(segment_intervals(points), axis=1)[:, 0]


def as_rope(points: ArrayLike) -> Floats:
    """Points as a float64 (V, 3) array.

    Raises:
        ValueError: not finite (V, 3) numbers within `FARTHEST` metres, or a single point.
    """
    rope = floats(points, "a rope shape")
    if rope.ndim != 2 or rope.shape[1] != 3 or len(rope) < 2:
        raise ValueError(f"a rope shape is (V, 3) points with V >= 2, got shape {rope.shape}")
    finite = np.isfinite(rope).all(axis=1)
    if not finite.all():
        vertex = int(np.argmin(finite))
        raise ValueError(f"rope vertex {vertex} is not finite: {rope[vertex].tolist()}")
    if (far := np.abs(rope).max()) > FARTHEST:
        raise ValueError(f"a rope's vertices are in metres, but one lies {far:.3g} m away")
    return rope


def _with_heights(
    rope: Floats, vertex_fractions: Floats, planar: PlanarCrossings, min_gap: float
) -> CurveCrossings:
    """The crossings in the plane, with the heights of the rope (V, 3) there."""
    count = len(planar.first)
    link = np.concatenate((planar.first, planar.second))  # (2c,)
    along = np.concatenate((planar.first_along, planar.second_along))
    points = rope[link] + along[:, None] * (rope[link + 1] - rope[link])  # (2c, 3)
    fractions = vertex_fractions[link] + along * (
        vertex_fractions[link + 1] - vertex_fractions[link]
    )
    gap = points[:count, 2] - points[count:, 2]  # (c,) first strand above second
    if count and np.abs(gap).min() < min_gap:
        worst = int(np.abs(gap).argmin())
        raise DegenerateCurveError(
            f"links {planar.first[worst]} and {planar.second[worst]} cross "
            f"{abs(gap[worst]) * 1e3:.3g} mm apart in height; over and under need at least "
            f"min_gap = {min_gap * 1e3:.3g} mm"
        )
    order = planar.order
    rank = np.empty(2 * count, dtype=np.int64)
    rank[order] = np.arange(1, 2 * count + 1)
    first_over = gap > 0
    over = np.where(first_over, rank[:count], rank[count:]).tolist()
    under = np.where(first_over, rank[count:], rank[:count]).tolist()
    sign = np.where(first_over, planar.turn, -planar.turn).astype(int).tolist()
    crossings = sorted(zip(over, under, sign, strict=True), key=lambda one: min(one[:2]))
    return CurveCrossings(tuple(crossings), fractions[order], points[order, :2], points[order, 2])


def _part_upright(rope: Floats, distance: float, ahead: bool) -> Floats:
    """Lay upright links down along the rope, so that nudging them does not twist a loop in.

    They are spread over `distance` metres toward the next vertex (`ahead`), or the one before.
    """
    if not ahead:
        return _part_upright(rope[::-1], distance, True)[::-1]
    parted = rope.copy()
    steps = np.linalg.norm(np.diff(rope[:, :2], axis=0), axis=1)
    upright = steps <= COINCIDENCE * steps.sum()
    apart = np.flatnonzero(~upright)  # links that are not upright
    for link in np.flatnonzero(upright):
        following = apart[apart > link]
        if len(following):
            start, stop = rope[following[0], :2], rope[following[0] + 1, :2]
            share = distance * (1.0 - (following[0] - link - 1) / len(rope))
        elif len(apart):
            # The rope ends upright: continue along its last direction.
            stop, start = rope[apart[-1] + 1, :2], rope[apart[-1], :2]
            share = distance * (link - apart[-1]) / len(rope)
        else:
            continue
        parted[link + 1, :2] += share * (stop - start) / np.linalg.norm(stop - start)
    return parted


@lru_cache(maxsize=16)
def _nudges(vertices: int) -> Floats:
    """(2 * pairs, V, 2) fixed directions to move vertices in, each with its opposite."""
    steps = np.random.default_rng(vertices).standard_normal((_NUDGED_PAIRS, vertices, 2))
    return np.concatenate((steps, -steps))

"""The self-crossings of a polyline in the plane, and its degeneracies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

COINCIDENCE = 1e-9
"""Share of the polyline's length below which two places coincide."""


class DegenerateCurveError(ValueError):
    """A rope shape whose projection does not determine its topological state."""


@dataclass(frozen=True, eq=False)
class PlanarCrossings:
    """The n proper self-crossings of a polyline in the plane, of links `first` < `second`."""

    first: Ints  # (n,) link indices; link i runs from vertex i to vertex i + 1
    second: Ints
    first_along: Floats  # (n,) places on these links, 0..1
    second_along: Floats
    turn: Floats  # (n,) sign of (direction of first x direction of second) . z
    passed: Floats  # (2n,) length of the polyline up to each passage, first[0..n), second[0..n)
    order: Ints  # (2n,) the same passages, in the order met from vertex 0
    degenerate: str  # what makes these crossings unreliable; empty if nothing does


def arc_lengths(curve: Floats) -> Floats:
    """Lengths (..., P) of polylines (..., P, D) up to each of their points."""
    steps = np.linalg.norm(np.diff(curve, axis=-2), axis=-1)
    begin = np.zeros((*steps.shape[:-1], 1))
    return np.concatenate([begin, np.cumsum(steps, axis=-1)], axis=-1)


def interpolate(places: NDArray[Any], along: NDArray[Any], points: NDArray[Any]) -> Floats:
    """Points (M, D) at `places` (M,) of a curve (N, D) that is at its points `along` (N,)."""
    return np.stack([np.interp(places, along, one) for one in points.T], axis=1)


def planar_crossings(xy: Floats) -> PlanarCrossings:
    """All self-crossings of a polyline xy (V, 2).

    Raises:
        DegenerateCurveError: the head or the tail lies on another link.
    """
    links = xy[1:] - xy[:-1]  # (E, 2)
    length = np.hypot(links[:, 0], links[:, 1])  # (E,)
    tolerance = COINCIDENCE * float(length.sum())
    # Twice the signed area of (link i, vertex k): which side of link i's line k is on.
    dx = xy[None, :, 0] - xy[:-1, None, 0]  # (E, V)
    dy = xy[None, :, 1] - xy[:-1, None, 1]
    side = links[:, :1] * dy - links[:, 1:] * dx  # (E, V)
    straddles = side[:, :-1] * side[:, 1:] < 0.0  # (E, E): link k has an end on each side of line i
    first, second = np.nonzero(straddles & straddles.T & _later_links(len(links)))
    degenerate = ""

    near_line = (np.abs(side) <= tolerance * length[:, None]) & _other_vertices(len(links))
    if near_line.any() or length.min() <= tolerance:
        degenerate = _touching(links, length, dx, dy, near_line)

    before, after = side[first, second], side[first, second + 1]  # ends of second, line of first
    begin, end = side[second, first], side[second, first + 1]  # ends of first, line of second
    first_along, second_along = begin / (begin - end), before / (before - after)
    reached = np.cumsum(length) - length  # (E,) length up to each link
    passed = np.concatenate(
        (
            reached[first] + first_along * length[first],
            reached[second] + second_along * length[second],
        )
    )
    order = np.argsort(passed)
    if not degenerate and len(order) and np.diff(passed[order]).min() <= tolerance:
        place = int(order[np.diff(passed[order]).argmin()])
        link = np.concatenate((first, second))[place]
        degenerate = f"three strands cross in one point of link {link}"
    # The second strand passes the first from right (negative side) to left for turn +1.
    return PlanarCrossings(
        first, second, first_along, second_along, np.sign(after - before), passed, order, degenerate
    )


def _touching(
    links: Floats, length: Floats, dx: Floats, dy: Floats, near_line: NDArray[np.bool_]
) -> str:
    """Name an upright link or a vertex that lies on another link; see `planar_crossings`."""
    tolerance = COINCIDENCE * float(length.sum())
    if length.min() <= tolerance:
        return f"link {int(length.argmin())} is upright"
    # (E, V) distance along the link from its start
    along = (links[:, :1] * dx + links[:, 1:] * dy) / length[:, None]
    on_link = near_line & (along >= -tolerance) & (along <= length[:, None] + tolerance)
    if not on_link.any():
        return ""
    for end, vertex in (("head", 0), ("tail", -1)):
        if on_link[:, vertex].any():
            link = int(on_link[:, vertex].argmax())
            raise DegenerateCurveError(
                f"the {end} lies on link {link} in the projection, so whether it crosses that "
                "link is not defined; move it clear of the strand or beyond it"
            )
    link, vertex = (int(index) for index in np.argwhere(on_link)[0])
    return f"vertex {vertex} lies on link {link}"


@lru_cache(maxsize=16)
def _later_links(count: int) -> NDArray[np.bool_]:
    """(E, E) pairs of links, the second after the first and sharing no vertex with it."""
    return np.triu(np.ones((count, count), dtype=bool), k=2)


@lru_cache(maxsize=16)
def _other_vertices(count: int) -> NDArray[np.bool_]:
    """(E, E + 1) pairs of a link and a vertex that is not its own."""
    return ~(np.eye(count, count + 1, dtype=bool) | np.eye(count, count + 1, k=1, dtype=bool))

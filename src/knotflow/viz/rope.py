"""A rope as a knot diagram: its true thickness, blue head, orange tail, gaps where it passes under.

A rope becomes outlines in metres, each of one colour, so that matplotlib and an animation draw the
same rope. At a crossing each edge of the lower strand ends at a set distance from the upper strand:
the gap runs along the upper strand, at whatever angle the two meet.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.topology import DegenerateCurveError, project
from knotflow.viz.palette import PAPER, rope_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAP = 0.32
"""Of the rope's width: what is left free on each side of an upper strand."""

_BANDS = 40  # of one colour each along a rope: looks smooth, and keeps an SVG small
_FINENESS = 5  # steps along the curve in a width of rope
_TURN = np.radians(8)  # in which an outline is straight
_REACH = 3.0  # widths along the lower strand: no gap is longer, however flat the crossing

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a rope in one colour.

    Attributes:
        outline: (P, 2) metres, a polygon seen from above.
        colour: '#rrggbb'.
        height: metres; higher pieces are drawn later.
    """

    outline: Floats
    colour: str
    height: float


@dataclass(frozen=True, eq=False)
class Cut:
    """Where the two edges (left, right) of a lower strand end and go on, in steps along it."""

    ends: tuple[float, float]
    resumes: tuple[float, float]


def draw_rope(
    axes: Axes, points: NDArray, width: float, *, bands: int = _BANDS, zorder: float = 2.0
) -> None:
    """Draw a rope (V, 3) of a width, both in metres, as seen from above."""
    from matplotlib.collections import PolyCollection

    pieces = rope_pieces(points, width, bands)
    colours = [piece.colour for piece in pieces]
    axes.add_collection(
        PolyCollection(
            [piece.outline for piece in pieces],
            facecolors=colours,
            edgecolors=colours,  # hides the seams between neighbours
            linewidths=0.3,
            clip_on=False,
            zorder=zorder,
        ),
        autolim=False,
    )


def rope_pieces(points: NDArray, width: float, bands: int = _BANDS) -> list[Piece]:
    """The drawing of a rope (V, 3) of a width in metres, the lowest piece first.

    The head is marked with a ring. A shape whose crossings cannot be read, as ropes in motion may
    have, is drawn without gaps.
    """
    points = np.asarray(points, np.float64)
    curve = _smooth(points, width)
    edges = _edges(curve[:, :2], width)
    bends = _bends(curve[:, :2])
    pieces: list[Piece] = []
    begin = (0.0, 0.0)
    last = float(len(curve) - 1)
    for cut in [*cuts(points, curve, edges, width), Cut((last, last), (last, last))]:
        pieces += _bands(curve, edges, bends, (begin, cut.ends), bands)
        begin = (max(begin[0], cut.resumes[0]), max(begin[1], cut.resumes[1]))
    pieces.append(_disc(curve[-1], 0.5 * width, rope_colour(1.0)))
    # What lies equally high stays in order: the last digits differ from one processor to the next.
    pieces.sort(key=lambda piece: round(piece.height, 5))
    # The mark is not to disappear under the rope that it ends.
    return [
        *pieces,
        _disc(curve[0], 0.72 * width, rope_colour(0.0)),
        _disc(curve[0], 0.4 * width, PAPER),
    ]


def cuts(points: Floats, curve: Floats, edges: Floats, width: float) -> list[Cut]:
    """A cut for each crossing of a rope (V, 3), in the order in which its lower strands are met.

    `curve` (N, 3) is the smooth rope, `edges` (2, N, 2) its left and right edge, all in metres.
    """
    try:
        crossings = project(points, min_gap=0.0)
    except DegenerateCurveError:
        return []
    reached = _reached(curve)
    places = np.searchsorted(reached / reached[-1], crossings.fractions)
    found = []
    for over, under, _ in crossings.crossings:
        upper, lower = _meeting(curve[:, :2], int(places[over - 1]), int(places[under - 1]), width)
        others = np.abs(reached[places] - reached[lower])
        others[[over - 1, under - 1]] = np.inf
        # Where the strand passes over another soon, it has to be seen.
        apart = abs(reached[upper] - reached[lower])
        reach = min(_REACH * width, 0.5 * apart, 0.5 * float(others.min()))
        below = np.flatnonzero(np.abs(reached - reached[lower]) <= reach)
        above = np.abs(reached - reached[upper]) <= min(2 * _REACH * width, 0.5 * apart)
        offset = edges[:, below, None] - curve[above, :2]  # (2, lower, upper, 2)
        room = np.linalg.norm(offset, axis=-1).min(axis=-1) - (0.5 + GAP) * width  # (2, lower)
        behind, ahead = below <= lower, below >= lower
        ends = (_clear_from(below[behind][::-1], edge[behind][::-1]) for edge in room)
        resumes = (_clear_from(below[ahead], edge[ahead]) for edge in room)
        found.append(Cut((next(ends), next(ends)), (next(resumes), next(resumes))))
    return sorted(found, key=lambda cut: cut.resumes)


def _clear_from(steps: NDArray[np.intp], room: Floats) -> float:
    """Where on consecutive steps (n,) the room (n,) rises above 0; the last step if it never does.

    `room` is interpolated, so that gaps are as wide on a coarse curve as on a fine one.
    """
    clear = np.flatnonzero(room > 0)
    if not len(clear):
        return float(steps[-1])
    after = int(clear[0])
    before = max(after - 1, 0)
    share = room[after] / (room[after] - room[before]) if before < after else 0.0
    return float(steps[after] + share * (steps[before] - steps[after]))


def _meeting(xy: Floats, upper: int, lower: int, width: float) -> tuple[int, int]:
    """Where two strands of the smooth curve are nearest, close to where their chords cross."""
    spread = 2 * _FINENESS
    over = np.arange(max(0, upper - spread), min(len(xy), upper + spread + 1))
    under = np.arange(max(0, lower - spread), min(len(xy), lower + spread + 1))
    apart = np.linalg.norm(xy[over, None] - xy[None, under], axis=-1)
    row, column = np.unravel_index(int(apart.argmin()), apart.shape)
    return int(over[row]), int(under[column])


def _bands(
    curve: Floats,
    edges: Floats,
    bends: NDArray[np.intp],
    shown: tuple[tuple[float, float], tuple[float, float]],
    bands: int,
) -> Iterator[Piece]:
    """A visible stretch in its colours; its edges (left, right) begin and end where they do.

    Where only one edge is visible yet, the outline's other side waits: its end is slanted.
    """
    begin, end = shown
    steps = np.arange(len(curve))
    seams = np.linspace(0, steps[-1], bands + 1)
    first, last = min(begin), max(end)
    bounds = [first, *seams[(seams > first) & (seams < last)], last] if first < last else []
    for low, high in itertools.pairwise(bounds):
        rungs = np.array([low, *bends[(bends > low) & (bends < high)], high])
        sides = []
        for edge, from_, to in zip(edges, begin, end, strict=True):
            places = np.clip(rungs, from_, max(from_, to))
            sides.append(np.column_stack([np.interp(places, steps, part) for part in edge.T]))
        outline = np.concatenate((sides[0], sides[1][::-1]))
        height = float(np.interp((low + high) / 2, steps, curve[:, 2]))
        yield Piece(outline, rope_colour((low + high) / 2 / steps[-1]), height)


def _bends(xy: Floats) -> NDArray[np.intp]:
    """The steps along a curve (N, 2) that its outline needs: one for each `_TURN`."""
    along = np.diff(xy, axis=0)
    heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    turned = np.r_[0.0, np.cumsum(np.abs(np.diff(heading)))]
    return np.flatnonzero(np.diff(turned // _TURN)) + 1


def _disc(place: Floats, radius: float, colour: str) -> Piece:
    """A disc round a place (3,), metres."""
    turn = np.linspace(0.0, 2 * np.pi, 25)[:-1]
    outline = place[:2] + radius * np.column_stack((np.cos(turn), np.sin(turn)))
    return Piece(outline, colour, float(place[2]))


def _edges(xy: Floats, width: float) -> Floats:
    """The left and the right edge (2, N, 2) of a curve (N, 2)."""
    along = np.gradient(xy, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = 0.5 * width * np.column_stack((-along[:, 1], along[:, 0]))
    return np.stack((xy + across, xy - across))


def _reached(curve: Floats) -> Floats:
    """(N,) metres of a curve up to each of its points."""
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]


def _smooth(points: Floats, width: float) -> Floats:
    """A Catmull-Rom curve (N, 3) through the vertices (V, 3), finer than the rope is wide."""
    link = _reached(points)[-1] / (len(points) - 1)
    pieces = int(np.clip(np.ceil(_FINENESS * link / width), 2, 24))
    before, after = 2 * points[:1] - points[1:2], 2 * points[-1:] - points[-2:-1]
    p = np.concatenate((before, points, after))
    u = (np.arange(pieces) / pieces)[:, None]
    basis = (
        -0.5 * u + u**2 - 0.5 * u**3,
        1 - 2.5 * u**2 + 1.5 * u**3,
        0.5 * u + 2 * u**2 - 1.5 * u**3,
        -0.5 * u**2 + 0.5 * u**3,
    )
    links = len(points) - 1
    curve = sum(b * p[k : k + links, None] for k, b in enumerate(basis))
    return np.concatenate((np.reshape(curve, (-1, 3)), points[-1:]))

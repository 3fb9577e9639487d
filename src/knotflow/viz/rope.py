"""A rope as a knot diagram: true thickness, blue head, orange tail, gaps where it passes under.

A rope becomes outlines in metres, each of one colour, for matplotlib and for animations.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotflow.topology import DegenerateCurveError, project
from knotflow.topology.polyline import Floats, arc_lengths, interpolate
from knotflow.viz.style import PAPER, rope_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAP = 0.32
"""Free space on each side of an upper strand, in widths of the rope."""

_BANDS = 40  # of one colour each along a rope: looks smooth, and keeps an SVG small
_FINENESS = 5  # steps along the curve in a width of rope
_TURN = np.radians(8)  # in which an outline is straight
_REACH = 3.0  # widths along the lower strand: the longest gap, however flat the crossing
Edges = tuple[float, float]
"""A step along the left edge of a rope and one along the right edge."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of a rope in one colour."""

    outline: Floats  # (P, 2) metres, a polygon seen from above
    colour: str  # '#rrggbb'
    height: float  # metres; higher pieces are drawn later


def draw_rope(
    axes: Axes, points: NDArray, width: float, *, bands: int = _BANDS, zorder: float = 2.0
) -> None:
    """Draw a rope (V, 3) of a width, both in metres, as seen from above."""
    from matplotlib.collections import PolyCollection

    pieces = rope_pieces(points, width, bands)
    outlines, colours = zip(*((piece.outline, piece.colour) for piece in pieces), strict=True)
    seams: dict[str, Any] = {"edgecolors": colours, "linewidths": 0.3}  # hides them
    drawn = PolyCollection(outlines, facecolors=colours, clip_on=False, zorder=zorder, **seams)
    axes.add_collection(drawn, autolim=False)


def rope_image(
    points: NDArray,
    width: float,
    xlim: tuple[float, float],
    ylim: tuple[float, float],
    size: tuple[int, int],
) -> NDArray[np.uint8]:
    """A rope (V, 3) from above in a window, all in metres, as pixels (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1), xlim=xlim, ylim=ylim, aspect="equal")
    axes.axis("off")
    draw_rope(axes, points, width)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def rope_pieces(points: NDArray, width: float, bands: int = _BANDS) -> list[Piece]:
    """The drawing of a rope (V, 3) of a width in metres, the lowest piece first.

    The head is a ring. A shape whose crossings cannot be read is drawn without gaps.
    """
    points = np.asarray(points, np.float64)
    curve = _smooth(points, width)
    along = np.gradient(curve[:, :2], axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = 0.5 * width * np.column_stack((-along[:, 1], along[:, 0]))
    edges = np.stack((curve[:, :2] + across, curve[:, :2] - across))  # left and right, (2, N, 2)
    pieces: list[Piece] = []
    begin = (0.0, 0.0)
    last = float(len(curve) - 1)
    for ends, resumes in [*_gaps(points, curve, edges, width), ((last, last), (last, last))]:
        pieces += _bands(curve, edges, begin, ends, bands)
        begin = (max(begin[0], resumes[0]), max(begin[1], resumes[1]))
    pieces.append(_disc(curve[-1], 0.5 * width, rope_colour(1.0)))
    # Rounded: the last digits differ from one processor to the next.
    pieces.sort(key=lambda piece: round(piece.height, 5))
    # The ring comes last: it must not disappear under the rope that it ends.
    ring = _disc(curve[0], 0.72 * width, rope_colour(0.0)), _disc(curve[0], 0.4 * width, PAPER)
    return [*pieces, *ring]


def _gaps(points: Floats, curve: Floats, edges: Floats, width: float) -> list[tuple[Edges, Edges]]:
    """Where each lower strand ends and resumes, in the order along the rope (V, 3).

    `curve` (N, 3) is the smooth rope, `edges` (2, N, 2) its left and right edge, all in metres.
    """
    try:
        crossings = project(points, min_gap=0.0)
    except DegenerateCurveError:
        return []
    reached = arc_lengths(curve)
    passages = np.searchsorted(reached / reached[-1], crossings.fractions)
    found = []
    for over, under, _ in crossings.crossings:
        upper, lower = _nearest(curve[:, :2], int(passages[over - 1]), int(passages[under - 1]))
        others = np.abs(reached[passages] - reached[lower])
        others[[over - 1, under - 1]] = np.inf
        # Where the strand passes over another soon, it has to be seen.
        apart = abs(reached[upper] - reached[lower])
        reach = min(_REACH * width, 0.5 * apart, 0.5 * float(others.min()))
        below = np.flatnonzero(np.abs(reached - reached[lower]) <= reach)
        above = np.abs(reached - reached[upper]) <= min(2 * _REACH * width, 0.5 * apart)
        offset = edges[:, below, None] - curve[above, :2]  # (2, lower, upper, 2)
        room = np.linalg.norm(offset, axis=-1).min(axis=-1) - (0.5 + GAP) * width  # (2, lower)
        back, ahead = (below <= lower).nonzero()[0][::-1], (below >= lower).nonzero()[0]
        ends, resumes = (
            (_clear_from(below[way], room[0, way]), _clear_from(below[way], room[1, way]))
            for way in (back, ahead)
        )
        found.append((ends, resumes))
    return sorted(found, key=lambda gap: gap[1])


def _clear_from(steps: NDArray[np.intp], room: Floats) -> float:
    """Where on steps (n,) the interpolated room (n,) rises above 0; else the last step."""
    clear = np.flatnonzero(room > 0)
    if not len(clear):
        return float(steps[-1])
    rising = slice(max(clear[0] - 1, 0), clear[0] + 1)
    return float(np.interp(0.0, room[rising], steps[rising]))


def _nearest(xy: Floats, upper: int, lower: int) -> tuple[int, int]:
    """Where two strands of the smooth curve are nearest, close to where their chords cross."""
    spread = 2 * _FINENESS
    over = np.arange(max(0, upper - spread), min(len(xy), upper + spread + 1))
    under = np.arange(max(0, lower - spread), min(len(xy), lower + spread + 1))
    apart = np.linalg.norm(xy[over, None] - xy[None, under], axis=-1)
    row, column = np.unravel_index(int(apart.argmin()), apart.shape)
    return int(over[row]), int(under[column])


def _bands(curve: Floats, edges: Floats, begin: Edges, end: Edges, bands: int) -> Iterator[Piece]:
    """A visible stretch in its colours, slanted at its ends where its edges end apart."""
    steps = np.arange(len(curve))
    heading = np.arctan2(*np.diff(curve[:, :2], axis=0).T[::-1])
    turned = np.r_[0.0, np.cumsum(np.abs(np.diff(np.unwrap(heading))))]
    bends = np.flatnonzero(np.diff(turned // _TURN)) + 1  # the steps that an outline needs
    seams = np.linspace(0, steps[-1], bands + 1)
    first, last = min(begin), max(end)
    bounds = [first, *seams[(seams > first) & (seams < last)], last] if first < last else []
    for low, high in itertools.pairwise(bounds):
        rungs = np.array([low, *bends[(bends > low) & (bends < high)], high])
        sides = []
        for edge, from_, to in zip(edges, begin, end, strict=True):
            visible = np.clip(rungs, from_, max(from_, to))
            sides.append(interpolate(visible, steps, edge))
        outline = np.concatenate((sides[0], sides[1][::-1]))
        height = float(np.interp((low + high) / 2, steps, curve[:, 2]))
        yield Piece(outline, rope_colour((low + high) / 2 / steps[-1]), height)


def _disc(centre: Floats, radius: float, colour: str) -> Piece:
    turn = np.linspace(0.0, 2 * np.pi, 25)[:-1]
    outline = centre[:2] + radius * np.column_stack((np.cos(turn), np.sin(turn)))
    return Piece(outline, colour, float(centre[2]))


def _smooth(points: Floats, width: float) -> Floats:
    """A Catmull-Rom curve (N, 3) through the vertices (V, 3), finer than the rope is wide."""
    from scipy.interpolate import CubicHermiteSpline

    links = len(points) - 1
    per_link = int(np.clip(np.ceil(_FINENESS * arc_lengths(points)[-1] / links / width), 2, 24))
    tangents = np.gradient(points, axis=0)
    curve = CubicHermiteSpline(np.arange(links + 1), points, tangents)
    return np.asarray(curve(np.linspace(0, links, per_link * links + 1)))

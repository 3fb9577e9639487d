"""What the pictures of ropes have in common: colours, smooth curves, over and under."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from knotflow.topology import CurveCrossings, DegenerateCurveError, project

INK = "#24292f"
MUTED = "#656d76"
RULE = "#d0d7de"
SPLINE = "#1a7f37"

ROPE_COLOURS = LinearSegmentedColormap.from_list(
    "rope", ["#0b5cad", "#2f9bd6", "#8fb8c4", "#f0b25a", "#e8710a"]
)
"""Blue at the head to orange at the tail, as in Fig. 9."""

_STYLE = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same everywhere
    "font.size": 9,
    "text.color": INK,
    "text.parse_math": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "none",
    "svg.hashsalt": "knotflow",
}
_SMOOTHING = 8  # drawn pieces a link
_BANDS = 60  # of one colour each along a rope: looks smooth, and keeps an SVG small


@contextmanager
def styled() -> Iterator[None]:
    """This package's style over matplotlib's own defaults, whatever the user's settings say."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        for name, value in _STYLE.items():
            matplotlib.rcParams[name] = value  # type: ignore[index]
        yield


@dataclass(frozen=True, eq=False)
class Ribbon:
    """A rope to draw: its smooth curve, and where it is hidden by a strand above.

    Attributes:
        xy: (N, 2) metres.
        along: (N,) fractions of the rope's length.
        hidden: (N - 1,) pieces that are left out.
    """

    xy: NDArray[np.float64]
    along: NDArray[np.float64]
    hidden: NDArray[np.bool_]


def ribbon(points: NDArray, width: float, smoothing: int = _SMOOTHING) -> Ribbon:
    """The drawing of a rope (V, 3), metres, with gaps for strands of a width in metres.

    Every link is drawn as `smoothing` pieces of a curve through the vertices.

    A shape whose projection cannot be read, as ropes in motion may have, is drawn without gaps.
    """
    points = np.asarray(points, np.float64)
    links = np.linalg.norm(np.diff(points, axis=0), axis=1)
    reached = np.r_[0.0, np.cumsum(links)]
    vertices = np.arange(len(points))
    at = np.linspace(0, len(points) - 1, smoothing * (len(points) - 1) + 1)
    along = np.interp(at, vertices, reached / reached[-1])
    xy = _smooth(points[:, :2], smoothing)
    middle = (along[1:] + along[:-1]) / 2
    hidden = np.zeros(len(middle), bool)
    try:
        crossings = project(points)
    except DegenerateCurveError:
        return Ribbon(xy, along, hidden)
    for place, half in _gaps(crossings, points, width):
        hidden |= np.abs(middle - place) * reached[-1] < half
    return Ribbon(xy, along, hidden)


def draw_ribbon(axes: Axes, rope: Ribbon, linewidth: float, zorder: float = 2.0) -> None:
    """Draw a rope, `linewidth` points wide, with a mark on its head."""
    lines, colours = [], []
    band = np.minimum(((rope.along[1:] + rope.along[:-1]) / 2 * _BANDS).astype(int), _BANDS - 1)
    begin = 0
    for piece in range(1, len(band) + 1):
        ended = piece == len(band) or band[piece] != band[begin]
        if ended or rope.hidden[piece] != rope.hidden[begin]:
            if not rope.hidden[begin]:
                lines.append(rope.xy[begin : piece + 1])
                colours.append(ROPE_COLOURS((band[begin] + 0.5) / _BANDS))
            begin = piece
    axes.add_collection(
        LineCollection(
            lines,
            colors=colours,
            linewidths=linewidth,
            capstyle="round",
            joinstyle="round",
            zorder=zorder,
        )
    )
    axes.plot(
        *rope.xy[0],
        "o",
        color="white",
        markeredgecolor=ROPE_COLOURS(0.0),
        markersize=1.15 * linewidth + 1.0,
        markeredgewidth=0.35 * linewidth,
        zorder=zorder + 0.1,
    )


def _gaps(
    crossings: CurveCrossings, points: NDArray, width: float
) -> Iterator[tuple[float, float]]:
    """(fraction, half length in metres) of each place where an under strand is hidden."""
    vertices = np.linspace(0.0, 1.0, len(points))
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    reached = np.r_[0.0, np.cumsum(steps)] / steps.sum()

    def direction(fraction: float) -> NDArray[np.float64]:
        index = np.interp(fraction, reached, vertices) * (len(points) - 1)
        link = min(int(index), len(points) - 2)
        along = points[link + 1, :2] - points[link, :2]
        return along / max(float(np.linalg.norm(along)), 1e-12)

    for over, under, _ in crossings.state.crossings:
        place = float(crossings.fractions[under - 1])
        across, along = direction(float(crossings.fractions[over - 1])), direction(place)
        sine = abs(across[0] * along[1] - across[1] * along[0])
        # Half the over strand, the round cap of the piece that ends here, and some white.
        yield place, (0.5 * width / max(float(sine), 0.5)) + 0.7 * width


def _smooth(xy: NDArray, pieces: int) -> NDArray[np.float64]:
    """A Catmull-Rom curve through the vertices (V, 2)."""
    before, after = 2 * xy[:1] - xy[1:2], 2 * xy[-1:] - xy[-2:-1]
    p = np.concatenate((before, xy, after))
    u = (np.arange(pieces) / pieces)[:, None]
    basis = (
        -0.5 * u + u**2 - 0.5 * u**3,
        1 - 2.5 * u**2 + 1.5 * u**3,
        0.5 * u + 2 * u**2 - 1.5 * u**3,
        -0.5 * u**2 + 0.5 * u**3,
    )
    links = len(xy) - 1
    curve = sum(b * p[k : k + links, None] for k, b in enumerate(basis))
    return np.concatenate((np.reshape(curve, (-1, 2)), xy[-1:]))

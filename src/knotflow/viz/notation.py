"""Pictures of the notation: knot diagrams with numbered segments and positions (Sec. IV, Table I).

Segments are numbered from 0, between the positions at which the rope meets its crossings, which
count from 1; both run from head to tail. Actions name segments, states name positions.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from knotflow.topology import CATALOGUE, Action, TopologicalState, parse_action, project
from knotflow.topology.action_text import describe
from knotflow.topology.draw import draw
from knotflow.topology.polyline import arc_lengths
from knotflow.viz import style
from knotflow.viz.rope import draw_rope
from knotflow.viz.style import INK, MUTED, PAPER, SPLINE, WIDTH

EXAMPLES: tuple[tuple[str, str], ...] = (
    ("R1(0,1,1)", "trivial"),
    ("R2(0,0,1,1)", "trivial"),
    ("C(0,2,1)", "2o1+"),
)
"""An action of each kind, with a state that allows it."""

_COLUMNS, _NAMES = 5, 0.62  # of the sheet of knots: diagrams in a row, inches below each
_PANEL = 2.6  # inches, side of a diagram
_ARROW = 1.3  # inches between the two diagrams of an action
_TITLE, _SENTENCE, _MARGIN = 0.32, 0.56, 0.15  # inches
_LABEL_OFFSET = 0.07  # of a diagram's side: from a crossing to the number of a position
_LEGEND = (
    "Ring: head.  Circles: segments, which actions name; green, those this action works on.  "
    "Small: positions, which states name.\n"
    "R1(segment, side, sign)   R2(over, under, side, first over)   C(over, under, sign)   "
    "a state: over o under sign, crossing by crossing"
)


def draw_action(action: Action, state: TopologicalState, path: Path) -> None:
    """Draw a state before and after an action; the suffix (png, svg, pdf) sets the format.

    Raises:
        IllegalActionError: the state does not allow the action; names the rule it breaks.
    """
    style.save_figure(_figure([(action, state)]), path)


@style.styled()
def draw_state(state: TopologicalState, path: Path) -> None:
    """Draw a state with its numbered segments and positions; formats as in `draw_action`."""
    figure = Figure(figsize=(_PANEL + 2 * _MARGIN, _PANEL + _TITLE + 2 * _MARGIN))
    _panel(style.inches(figure), (_MARGIN, _MARGIN), state, str(state), [])
    style.save_figure(figure, path)


def draw_notation(path: Path) -> None:
    """Draw one action of each kind, with the legend: the notation on one page."""
    examples = [(parse_action(a), TopologicalState.parse(s)) for a, s in EXAMPLES]
    style.save_figure(_figure(examples), path)


@style.styled()
def draw_knots(path: Path) -> None:
    """Draw a diagram of each knot in the catalogue, with its names and use."""
    shown = [one for one in CATALOGUE if one.diagrams != ("trivial",)]
    rows = -(-len(shown) // _COLUMNS)
    size = WIDTH / _COLUMNS
    figure = Figure(figsize=(WIDTH, rows * (size + _NAMES)))
    canvas = style.inches(figure)
    for number, one in enumerate(shown):
        row, column = divmod(number, _COLUMNS)
        left, bottom = column * size, (rows - row - 1) * (size + _NAMES)
        place = left + 0.06, bottom + _NAMES + 0.06, size - 0.12, size - 0.12
        axes = canvas.inset_axes(place, transform=canvas.transData)
        draw_diagram(axes, TopologicalState.parse(one.diagrams[0]), strand=0.04)
        names = ", ".join([one.name, *one.aliases[:1]])
        words = textwrap.fill(one.use, 30)
        middle, top = left + size / 2, bottom + _NAMES
        canvas.text(middle, top - 0.05, names, size=9, ha="center", va="top")
        canvas.text(middle, top - 0.23, words, size=7, color=MUTED, ha="center", va="top")
    style.save_figure(figure, path)


def draw_diagram(
    axes: Axes, state: TopologicalState, *, strand: float, padding: float = 0.12, samples: int = 8
) -> tuple[NDArray[np.float64], float]:
    """Draw a state as a rope in a square window of `axes`.

    The width of the `strand` is a fraction of the window's side, its `padding` one of the rope's
    extent; `samples` is the smoothness, see `topology.draw.draw`.

    Returns:
        The rope (V, 3) and the window's side, in the units of the axes.
    """
    points = draw(state, samples=samples)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    side = (1 + padding) * float((high - low).max())
    (left, bottom), (right, top) = (low + high - side) / 2, (low + high + side) / 2
    axes.axis("off")
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    draw_rope(axes, points, strand * side)
    return points, side


@style.styled()
def _figure(rows: Sequence[tuple[Action, TopologicalState]]) -> Figure:
    """A row for each action, and the legend below."""
    width = max(WIDTH, 2 * _PANEL + _ARROW + 2 * _MARGIN)
    row_height = _PANEL + _TITLE + _SENTENCE
    height = len(rows) * row_height + 0.45 + 2 * _MARGIN
    figure = Figure(figsize=(width, height))
    canvas = style.inches(figure)
    left = (width - 2 * _PANEL - _ARROW) / 2
    for row, (action, state) in enumerate(rows, 1):
        after = state.apply(action)
        bottom = height - _MARGIN - row * row_height + _SENTENCE
        _panel(canvas, (left, bottom), state, f"before: {state}", action.segments)
        _panel(canvas, (left + _PANEL + _ARROW, bottom), after, f"after: {after}", [])
        middle = left + _PANEL + _ARROW / 2, bottom + _PANEL / 2
        canvas.text(middle[0], middle[1] + 0.1, str(action), ha="center", size=10)
        canvas.text(middle[0], middle[1] - 0.2, "→", ha="center", size=20)
        sentence = textwrap.fill(describe(action, state), 112)
        canvas.text(width / 2, bottom - 0.08, sentence, ha="center", va="top")
    canvas.text(width / 2, _MARGIN, _LEGEND, ha="center", color=MUTED, size=7.5)
    return figure


def _panel(
    canvas: Axes,
    corner: tuple[float, float],
    state: TopologicalState,
    title: str,
    highlighted: Sequence[int],
) -> None:
    """A diagram with its numbers, segments in `highlighted` in green; lower left corner, inches."""
    axes = canvas.inset_axes((*corner, _PANEL, _PANEL), transform=canvas.transData)
    points, side = draw_diagram(axes, state, strand=0.03)
    centre, top = corner[0] + _PANEL / 2, corner[1] + _PANEL + 0.08
    canvas.text(centre, top, title, ha="center", size=10 if len(title) < 40 else 7)

    crossings = project(points, min_gap=0.0)
    lengths = arc_lengths(points)

    def at(fraction: float) -> NDArray[np.float64]:
        along = fraction * lengths[-1]
        return np.array([np.interp(along, lengths, column) for column in points[:, :2].T])

    occupied = [points[:, :2]]
    for segment, (begin, end) in enumerate(crossings.segment_intervals):
        middle, chosen = at((begin + end) / 2), segment in highlighted
        occupied.append(middle[None])
        box = {
            "boxstyle": "circle,pad=0.2",
            "facecolor": SPLINE if chosen else PAPER,
            "edgecolor": SPLINE if chosen else style.rope_colour((begin + end) / 2),
            "linewidth": 1.2,
        }
        colour = PAPER if chosen else INK
        _number(axes, segment, middle, size=7, weight="bold", color=colour, bbox=box)
    for position, fraction in enumerate(crossings.fractions, 1):
        # Beside its own strand, just before the crossing, in the direction with the most room.
        here = at(fraction)
        back = at(max(0.0, fraction - 1e-3)) - here
        angle = np.arctan2(back[1], back[0]) + np.radians([-80, -65, -50, -35, 35, 50, 65, 80])
        places = here + _LABEL_OFFSET * side * np.column_stack((np.cos(angle), np.sin(angle)))
        distance = np.linalg.norm(places[:, None] - np.concatenate(occupied)[None], axis=-1)
        place = places[distance.min(axis=1).argmax()]
        occupied.append(place[None])
        _number(axes, position, place, size=6.5, color=MUTED)


def _number(axes: Axes, number: int, place: NDArray, **look: Any) -> None:
    axes.text(place[0], place[1], str(number), ha="center", va="center", zorder=6, **look)

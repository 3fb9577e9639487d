"""Pictures of the notation: knot diagrams with numbered segments and positions (Sec. IV, Table I).

Segments are numbered from 0, between the positions at which the rope meets its crossings, which
count from 1; both run from head to tail. Actions speak of segments, states of positions.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from knotflow.topology import Action, TopologicalState, parse_action, project
from knotflow.topology.action_text import describe
from knotflow.topology.draw import draw
from knotflow.viz.palette import INK, MUTED, PAPER, SPLINE, rope_colour
from knotflow.viz.rope import draw_rope
from knotflow.viz.style import PNG_DPI, WIDTH, styled

EXAMPLES: tuple[tuple[str, str], ...] = (
    ("R1(0,1,1)", "trivial"),
    ("R2(0,0,1,1)", "trivial"),
    ("C(0,2,1)", "2o1+"),
)
"""An action of each kind, with a state that allows it."""

_PANEL = 2.6  # inches, side of a diagram
_ARROW = 1.3  # inches between the two diagrams of an action
_TITLE, _WORDS, _MARGIN = 0.32, 0.56, 0.15  # inches
_STRAND = 0.03  # of a panel's side: width of the rope
_AWAY = 0.07  # of a panel's side: of a position's number from its crossing
_KEY = (
    "Ring: head.  Circles: segments, which actions name; green, those this action works on.  "
    "Small: positions, which states name.\n"
    "R1(segment, side, sign)   R2(over, under, side, first over)   C(over, under, sign)   "
    "a state: over o under sign, crossing by crossing"
)


def draw_action(action: Action, state: TopologicalState, path: Path) -> str:
    """Draw a state before and after an action, and say in a sentence what the action does.

    Args:
        action: what is done.
        state: before; the action has to be legal there.
        path: of the picture; its suffix (png, svg, pdf) sets the format.

    Returns:
        The sentence, which stands in the picture, too.

    Raises:
        IllegalActionError: the state does not allow the action; says which rule it breaks.
    """
    sentence = describe(action, state)
    with styled():
        _save(_figure([(action, state)]), path)
    return sentence


def draw_state(state: TopologicalState, path: Path) -> None:
    """Draw a state with its numbered segments and positions; formats as in `draw_action`."""
    with styled():
        figure = Figure(figsize=(_PANEL + 2 * _MARGIN, _PANEL + _TITLE + 2 * _MARGIN))
        _panel(figure, (_MARGIN, _MARGIN), state, str(state), [])
        _save(figure, path)


def draw_notation(path: Path) -> None:
    """Draw one action of each kind, with the legend: the notation on one page."""
    with styled():
        _save(_figure([(parse_action(a), TopologicalState.parse(s)) for a, s in EXAMPLES]), path)


def _figure(rows: Sequence[tuple[Action, TopologicalState]]) -> Figure:
    """A row for each action, the legend below."""
    width = max(WIDTH, 2 * _PANEL + _ARROW + 2 * _MARGIN)
    row_height = _PANEL + _TITLE + _WORDS
    height = len(rows) * row_height + 0.45 + 2 * _MARGIN
    figure = Figure(figsize=(width, height))
    left = (width - 2 * _PANEL - _ARROW) / 2
    for index, (action, state) in enumerate(rows):
        after = state.apply(action)
        bottom = height - _MARGIN - (index + 1) * row_height + _WORDS
        _panel(figure, (left, bottom), state, f"before: {state}", action.segments)
        _panel(figure, (left + _PANEL + _ARROW, bottom), after, f"after: {after}", [])
        middle = (left + _PANEL + _ARROW / 2) / width
        figure.text(middle, (bottom + _PANEL / 2 + 0.1) / height, str(action), ha="center", size=10)
        figure.text(middle, (bottom + _PANEL / 2 - 0.2) / height, "→", ha="center", size=20)
        words = textwrap.fill(describe(action, state), 112)
        figure.text(0.5, (bottom - 0.08) / height, words, ha="center", va="top", color=INK)
    figure.text(0.5, _MARGIN / height, _KEY, ha="center", va="bottom", color=MUTED, size=7.5)
    return figure


def _panel(
    figure: Figure,
    place: tuple[float, float],
    state: TopologicalState,
    title: str,
    lit: Sequence[int],
) -> None:
    """A diagram with its numbers; `place` is its lower left corner, inches, `lit` in green."""
    width, height = figure.get_size_inches()
    axes = figure.add_axes(
        (place[0] / width, place[1] / height, _PANEL / width, _PANEL / height), aspect="equal"
    )
    axes.axis("off")
    points = draw(state)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    side = 1.12 * float((high - low).max())
    middle = (low + high) / 2
    axes.set(
        xlim=(middle[0] - side / 2, middle[0] + side / 2),
        ylim=(middle[1] - side / 2, middle[1] + side / 2),
    )
    draw_rope(axes, points, _STRAND * side)
    figure.text(
        (place[0] + _PANEL / 2) / width,
        (place[1] + _PANEL + 0.08) / height,
        title,
        ha="center",
        size=10 if len(title) < 40 else 7,
    )
    _number(axes, points, side, lit)


def _number(axes: Axes, points: NDArray, side: float, lit: Sequence[int]) -> None:
    """Write the number of each segment on its middle, of each position beside its crossing."""
    crossings = project(points, min_gap=0.0)
    flat = points[:, :2]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.r_[0.0, np.cumsum(steps)] / steps.sum()

    def at(fraction: float) -> NDArray[np.float64]:
        return np.array([np.interp(fraction, along, flat[:, k]) for k in range(2)])

    taken = [flat]  # what a number must not cover
    for segment, (begin, end) in enumerate(crossings.segment_intervals):
        middle = at((begin + end) / 2)
        taken.append(middle[None])
        axes.text(
            float(middle[0]),
            float(middle[1]),
            str(segment),
            ha="center",
            va="center",
            size=7,
            weight="bold",
            color=PAPER if segment in lit else INK,
            bbox={
                "boxstyle": "circle,pad=0.2",
                "facecolor": SPLINE if segment in lit else PAPER,
                "edgecolor": SPLINE if segment in lit else rope_colour((begin + end) / 2),
                "linewidth": 1.2,
            },
            zorder=6,
        )
    for position, fraction in enumerate(crossings.fractions, 1):
        # Beside its own strand, just before the crossing, where there is most room.
        here = at(fraction)
        back = at(max(0.0, fraction - 1e-3)) - here
        angle = np.arctan2(back[1], back[0]) + np.radians([-80, -65, -50, -35, 35, 50, 65, 80])
        places = here + _AWAY * side * np.column_stack((np.cos(angle), np.sin(angle)))
        apart = np.linalg.norm(places[:, None] - np.concatenate(taken)[None], axis=-1)
        place = places[apart.min(axis=1).argmax()]
        taken.append(place[None])
        axes.text(
            float(place[0]),
            float(place[1]),
            str(position),
            ha="center",
            va="center",
            size=6.5,
            color=MUTED,
            zorder=7,
        )


def _save(figure: Figure, path: Path) -> None:
    # An SVG with its date would change each time it is drawn.
    metadata = {"Date": None} if Path(path).suffix == ".svg" else {}
    figure.savefig(path, dpi=PNG_DPI, metadata=metadata)

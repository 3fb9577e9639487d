"""The picture of a solution DAG, after the top of Fig. 1: knot diagrams joined by actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from numpy.typing import NDArray

from knotflow.planning.dag import SolutionDag
from knotflow.topology import Action, TopologicalState
from knotflow.topology.draw import draw
from knotflow.viz.palette import INK, MUTED, RULE, SPLINE
from knotflow.viz.rope import draw_rope
from knotflow.viz.style import styled

_BOX = 1.15  # inches, side of a state's box
_STRAND = 0.05  # inches, width of a rope
_COLUMN, _ROW = 1.6, 2.15  # inches from box to box
_MARGIN = 0.25  # inches
_SWEEPS = 12  # of the ordering that lessens crossing edges
_DPI = 110
_EDGE = "#a8b1bb"
_TEXT_ROW = 0.13  # inches, height of a line of edge labels

Place = NDArray[np.float64]


def draw_dag(
    dag: SolutionDag,
    paths: Sequence[Path],
    highlight: Sequence[Action] = (),
    start: TopologicalState | None = None,
) -> None:
    """Draw every state of a solution DAG as a knot diagram, and its actions on the edges.

    A row has the states with one number of crossings, the goals are framed in green.

    Args:
        dag: what to draw; `dag.after(state)` gives the part that a tangled rope can walk through.
        paths: the pictures to write; each suffix (svg, png, pdf) sets its format.
        highlight: a path of actions to draw in green, such as a plan's.
        start: where that path begins; the trivial state if None.

    Raises:
        ValueError: `highlight` leaves the DAG.
    """
    with styled():
        figure = dag_figure(dag, highlight, start)
        for path in paths:
            # An SVG with its date would change each time it is drawn.
            metadata = {"Date": None} if Path(path).suffix == ".svg" else {}
            figure.savefig(path, dpi=_DPI, metadata=metadata)


@dataclass(frozen=True)
class _Arrow:
    """All actions from one state to another."""

    begin: TopologicalState
    end: TopologicalState
    actions: tuple[str, ...]
    lit: bool


def dag_figure(
    dag: SolutionDag,
    highlight: Sequence[Action] = (),
    start: TopologicalState | None = None,
) -> Figure:
    """The figure of `draw_dag`; call it within `drawing.style.styled()`."""
    rows = _layers(dag)
    width = max(len(row) for row in rows) * _COLUMN + 2 * _MARGIN
    height = (len(rows) - 1) * _ROW + _BOX + 2 * _MARGIN + 0.2
    figure = Figure(figsize=(width, height))
    canvas = figure.add_axes((0, 0, 1, 1))
    canvas.axis("off")
    canvas.set(xlim=(0, width), ylim=(0, height))
    places: dict[TopologicalState, Place] = {}
    for index, row in enumerate(rows):
        step = (width - 2 * _MARGIN) / len(row)
        y = height - _MARGIN - _BOX / 2 - index * _ROW
        for column, state in enumerate(row):
            places[state] = np.array([_MARGIN + (column + 0.5) * step, y])
    lit = _lit_edges(dag, highlight, start)
    _draw_arrows(canvas, _arrows(dag, lit), places)
    for state, place in places.items():
        _draw_state(figure, canvas, state, place, state in dag.goals)
    return figure


def _layers(dag: SolutionDag) -> list[list[TopologicalState]]:
    """States by crossings, in an order in which edges cross little (barycentres)."""
    levels: dict[int, list[TopologicalState]] = {}
    for state in sorted(dag.graph):
        levels.setdefault(state.num_crossings, []).append(state)
    rows = [levels[level] for level in sorted(levels)]
    for sweep in range(_SWEEPS):
        downward = sweep % 2 == 0
        order = {s: (k + 0.5) / len(row) for row in rows for k, s in enumerate(row)}
        for row in rows if downward else rows[::-1]:
            near = dag.graph.predecessors if downward else dag.graph.successors

            def centre(state: TopologicalState) -> float:
                others = [order[other] for other in near(state)]  # noqa: B023
                return float(np.mean(others)) if others else order[state]  # noqa: B023

            row.sort(key=centre)
            order |= {s: (k + 0.5) / len(row) for k, s in enumerate(row)}
    return rows


def _lit_edges(
    dag: SolutionDag, highlight: Sequence[Action], start: TopologicalState | None
) -> set[tuple[TopologicalState, TopologicalState]]:
    state = start if start is not None else TopologicalState.trivial()
    lit = set()
    for action in highlight:
        onward = dict(dag.edges_from(state)) if state in dag else {}
        if action not in onward:
            raise ValueError(f"the DAG has no edge {action} from the state {state}")
        lit.add((state, onward[action]))
        state = onward[action]
    return lit


def _arrows(dag: SolutionDag, lit: set[tuple[TopologicalState, TopologicalState]]) -> list[_Arrow]:
    actions: dict[tuple[TopologicalState, TopologicalState], list[str]] = {}
    for begin in sorted(dag.graph):
        for action, end in dag.edges_from(begin):
            actions.setdefault((begin, end), []).append(str(action))
    return [
        _Arrow(begin, end, tuple(names), (begin, end) in lit)
        for (begin, end), names in actions.items()
    ]


def _draw_arrows(canvas: Axes, arrows: list[_Arrow], places: dict[TopologicalState, Place]) -> None:
    """Edges from one box to another, down or, undoing, up; labels where they meet least."""
    taken: list[tuple[float, float, float, float]] = []
    # Few choices first: an edge with many labels takes more room than one with a single label.
    for arrow in sorted(arrows, key=lambda arrow: -len(arrow.actions)):
        begin, end = places[arrow.begin], places[arrow.end]
        spread = 0.35 * _BOX * np.clip((end - begin)[0] / (2.0 * _COLUMN), -1.0, 1.0)
        if end[1] > begin[1]:  # an undoing, beside the action that it takes back
            tail = begin + (spread + 0.4 * _BOX, _BOX / 2)
            head = end + (-spread + 0.4 * _BOX, -_BOX / 2 - 0.17)
        else:
            tail = begin + (spread, -_BOX / 2 - 0.17)
            head = end + (-spread, _BOX / 2)
        far = begin[1] - end[1] > 1.5 * _ROW  # it passes a row of boxes: bend it round them
        colour = SPLINE if arrow.lit else _EDGE
        canvas.add_patch(
            FancyArrowPatch(
                tuple(tail),
                tuple(head),
                arrowstyle="-|>",
                mutation_scale=9,
                linewidth=2.0 if arrow.lit else 1.0,
                color=colour,
                connectionstyle=f"arc3,rad={0.25 if far else 0.0}",
                zorder=2 if arrow.lit else 1,
            )
        )
        text = "\n".join(arrow.actions)
        size = np.array([0.075 * max(map(len, arrow.actions)), _TEXT_ROW * len(arrow.actions)])
        centre = _free_place(tail, head, size, taken)
        taken.append((*(centre - size / 2), *(centre + size / 2)))
        canvas.text(
            float(centre[0]),
            float(centre[1]),
            text,
            ha="center",
            va="center",
            fontsize=7,
            color=SPLINE if arrow.lit else INK,
            weight="bold" if arrow.lit else "normal",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.9},
            zorder=3,
        )


def _free_place(
    tail: Place, head: Place, size: Place, taken: list[tuple[float, float, float, float]]
) -> Place:
    """Where on the edge its label overlaps the others least, near the edge's beginning if it can:
    there edges of different states do not cross yet, so that a label's edge is plain to see."""

    def overlap(centre: Place) -> float:
        low, high = centre - size / 2, centre + size / 2
        return sum(
            max(0.0, min(high[0], x1) - max(low[0], x0))
            * max(0.0, min(high[1], y1) - max(low[1], y0))
            for x0, y0, x1, y1 in taken
        )

    shares = sorted(np.linspace(0.15, 0.75, 13), key=lambda share: abs(share - 0.3))
    places = [tail + share * (head - tail) for share in shares]
    return min(places, key=overlap)


def _draw_state(
    figure: Figure, canvas: Axes, state: TopologicalState, place: Place, goal: bool
) -> None:
    x, y = place - _BOX / 2
    canvas.add_patch(
        FancyBboxPatch(
            (x, y),
            _BOX,
            _BOX,
            boxstyle="round,pad=0,rounding_size=0.08",
            facecolor="white",
            edgecolor=SPLINE if goal else RULE,
            linewidth=2.0 if goal else 1.0,
            zorder=4,
        )
    )
    name = str(state)
    canvas.text(
        place[0],
        y - 0.03,
        name,
        ha="center",
        va="top",
        fontsize=7 if len(name) < 20 else 5.5,
        color=MUTED,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
        zorder=3.5,
    )
    width, height = figure.get_size_inches()
    inset = 0.07
    axes = figure.add_axes(
        (
            (x + inset) / width,
            (y + inset) / height,
            (_BOX - 2 * inset) / width,
            (_BOX - 2 * inset) / height,
        )
    )
    axes.axis("off")
    points = draw(state, samples=3)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    side = 1.15 * float((high - low).max())
    middle = (low + high) / 2
    axes.set(
        xlim=(middle[0] - side / 2, middle[0] + side / 2),
        ylim=(middle[1] - side / 2, middle[1] + side / 2),
    )
    draw_rope(axes, points, _STRAND * side / (_BOX - 2 * inset), bands=24)

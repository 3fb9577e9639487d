"""The picture of a solution DAG, after the top of Fig. 1: knot diagrams joined by actions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from numpy.typing import NDArray

from knotflow.planning.goals import SolutionDag
from knotflow.topology import Action, TopologicalState
from knotflow.viz.notation import draw_diagram
from knotflow.viz.style import INK, MUTED, RULE, SPLINE, save_figure, styled

_BOX = 1.15  # inches, side of a state's box
_CELL = np.array([1.9, 2.15])  # inches from box to box
_CAPTION = 0.17  # inches below a box
_LABEL_AT = 0.24  # of an edge from its tail: there edges of different states do not cross yet
_SWEEPS = 6
_MARGIN = 0.35  # inches
_DPI = 110
_EDGE = "#a8b1bb"


def draw_dag(
    dag: SolutionDag,
    paths: Sequence[Path],
    highlight: Sequence[Action] = (),
    start: TopologicalState | None = None,
) -> None:
    """Draw every state of a solution DAG as a knot diagram, and its actions on the edges.

    A row has the states with one number of crossings. Green are the frames of the goals and the
    actions of `highlight`, a path from `start` (the trivial state if None), such as a plan's. The
    suffix of a path (svg, png, pdf) sets a picture's format.

    Raises:
        ValueError: `highlight` leaves the DAG.
    """
    figure = dag_figure(dag, highlight, start)
    for path in paths:
        save_figure(figure, path, _DPI)


@styled()
def dag_figure(
    dag: SolutionDag, highlight: Sequence[Action] = (), start: TopologicalState | None = None
) -> Figure:
    """The figure of `draw_dag`."""
    layout = _layout(dag)
    lit = _lit_edges(dag, highlight, start or TopologicalState.trivial())
    places = np.array([*layout.values()])
    low, high = places.min(axis=0) - _BOX / 2 - _MARGIN, places.max(axis=0) + _BOX / 2 + _MARGIN
    figure = Figure(figsize=tuple(high - low))
    canvas = figure.add_axes((0, 0, 1, 1))
    canvas.axis("off")
    canvas.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    actions: dict[tuple[TopologicalState, TopologicalState], list[str]] = {}
    for begin in sorted(dag.graph):
        for action, end in dag.edges_from(begin):
            actions.setdefault((begin, end), []).append(str(action))
    for (begin, end), names in actions.items():
        _draw_edge(canvas, layout[begin], layout[end], names, (begin, end) in lit)
    for state, centre in layout.items():
        _draw_state(canvas, state, centre, state in dag.goals)
    return figure


def _layout(dag: SolutionDag) -> dict[TopologicalState, NDArray[np.float64]]:
    """Centres of the boxes, inches: a row for each number of crossings."""
    rows: dict[int, list[TopologicalState]] = {}
    for state in sorted(dag.graph):
        rows.setdefault(-state.num_crossings, []).append(state)
    undirected = dag.graph.to_undirected(as_view=True)
    for level in [*sorted(rows), *sorted(rows, reverse=True)] * _SWEEPS:
        # Barycentres: a state stands where its neighbours are, so that few edges cross.
        order = {s: (k + 0.5) / len(row) for row in rows.values() for k, s in enumerate(row)}
        rank = {s: np.mean([order[near] for near in [*undirected[s]] or [s]]) for s in rows[level]}
        rows[level].sort(key=rank.__getitem__)
    size = max(len(rows), *map(len, rows.values()))
    unit = nx.multipartite_layout(dag.graph, rows, "horizontal", scale=max(size - 1, 1) / 2)
    return {state: place * _CELL for state, place in unit.items()}


def _lit_edges(
    dag: SolutionDag, highlight: Sequence[Action], state: TopologicalState
) -> set[tuple[TopologicalState, TopologicalState]]:
    lit = set()
    for action in highlight:
        successors = dict(dag.edges_from(state)) if state in dag else {}
        if action not in successors:
            raise ValueError(f"the DAG has no edge {action} from the state {state}")
        lit.add((state, successors[action]))
        state = successors[action]
    return lit


def _draw_edge(
    canvas: Axes, begin: NDArray, end: NDArray, actions: Sequence[str], lit: bool
) -> None:
    """An arrow from box to box, down or, for an undoing, up, with its actions near its tail."""
    spread = 0.35 * _BOX * float(np.clip((end - begin)[0] / _CELL[0], -1.0, 1.0))
    down = begin[1] > end[1]
    # An undoing runs beside the action that it takes back.
    side = 0.0 if down else 0.4 * _BOX
    gaps = (-_BOX / 2 - _CAPTION, _BOX / 2) if down else (_BOX / 2, -_BOX / 2 - _CAPTION)
    tail, head = begin + (spread + side, gaps[0]), end + (side - spread, gaps[1])
    passes_row = begin[1] - end[1] > 1.5 * _CELL[1]
    colour, width = (SPLINE, 2.0) if lit else (_EDGE, 1.0)
    bend = f"arc3,rad={0.25 if passes_row else 0.0}"
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 9, "connectionstyle": bend}
    arrow |= {"linewidth": width, "color": colour, "zorder": width}
    canvas.add_patch(FancyArrowPatch(tuple(tail), tuple(head), **arrow))
    x, y = tail + _LABEL_AT * (head - tail)
    style: dict[str, Any] = {"color": INK, "fontsize": 7, "ha": "center", "va": "center"}
    if lit:
        style |= {"color": SPLINE, "weight": "bold"}
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.9}
    name = "\n".join(actions)
    canvas.text(x, y, name, bbox=box, zorder=3, **style)


def _draw_state(canvas: Axes, state: TopologicalState, centre: NDArray, goal: bool) -> None:
    """The state's diagram in a box, with its name below."""
    x, y = centre - _BOX / 2
    frame: dict[str, Any] = {"edgecolor": RULE, "linewidth": 1.0, "facecolor": "white"}
    if goal:
        frame |= {"edgecolor": SPLINE, "linewidth": 2.0}
    shape = "round,pad=0,rounding_size=0.08"
    canvas.add_patch(FancyBboxPatch((x, y), _BOX, _BOX, boxstyle=shape, zorder=4, **frame))
    size, name = 7 if len(str(state)) < 20 else 5.5, str(state)
    style: dict[str, Any] = {"ha": "center", "va": "top", "fontsize": size, "color": MUTED}
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    canvas.text(centre[0], y - 0.03, name, bbox=box, zorder=3.5, **style)
    inset = (x + 0.07, y + 0.07, _BOX - 0.14, _BOX - 0.14)
    axes = canvas.inset_axes(inset, transform=canvas.transData)
    draw_diagram(axes, state, strand=0.05, padding=0.15, samples=3)

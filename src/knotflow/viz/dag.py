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
from matplotlib.path import Path as MplPath
from numpy.typing import NDArray

from knotflow.planning.goals import SolutionDag
from knotflow.topology import Action, TopologicalState
from knotflow.viz.notation import draw_diagram
from knotflow.viz.style import INK, MUTED, RULE, SPLINE, save_figure, styled

_BOX = 1.15  # inches, side of a state's box
_CELL = np.array([1.9, 2.15])  # inches from box to box
_CAPTION = 0.17  # inches below a box
_LABELS_AT = (0.25, 0.5, 0.75, *np.arange(0.1, 0.9, 0.05).tolist())  # of the way to the next row
_LETTER, _LINE = 0.066, 0.13  # inches of a label
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
    labels: list[NDArray[np.float64]] = []
    for (begin, end), names in actions.items():
        path = _edge_path(layout[begin], layout[end], places)
        _draw_edge(canvas, path, (begin, end) in lit)
        _label_edge(canvas, path, names, (begin, end) in lit, labels)
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


def _edge_path(begin: NDArray, end: NDArray, places: NDArray) -> NDArray[np.float64]:
    """A line (N, 2) from box to box, down or, for an undoing, up, between the boxes of rows that it
    passes; `places` (S, 2) are the centres of all boxes."""
    from scipy.interpolate import PchipInterpolator

    spread = 0.35 * _BOX * float(np.clip((end - begin)[0] / _CELL[0], -1.0, 1.0))
    down = begin[1] > end[1]
    # An undoing runs beside the action that it takes back.
    side = 0.0 if down else 0.4 * _BOX
    gaps = (-_BOX / 2 - _CAPTION, _BOX / 2) if down else (_BOX / 2, -_BOX / 2 - _CAPTION)
    tail, head = begin + (spread + side, gaps[0]), end + (side - spread, gaps[1])
    straight = np.linspace(tail, head, 60)
    low, high = sorted((begin[1], end[1]))
    passed = {y for y in places[:, 1].tolist() if low + 0.1 < y < high - 0.1}
    if not passed:
        return straight
    points = [tail, head]
    for y in passed:
        row = places[places[:, 1] == y, 0]
        lanes = np.concatenate([row - _CELL[0] / 2, row + _CELL[0] / 2])
        x = tail[0] + (y - tail[1]) / (head[1] - tail[1]) * (head[0] - tail[0])
        lane = lanes[np.abs(lanes - x).argmin()]
        points += [np.array([lane, y - gap]) for gap in gaps]
    across, along = np.array(sorted(points, key=lambda point: point[1])).T
    height = straight[:, 1]
    return np.column_stack([PchipInterpolator(along, across)(height), height])


def _draw_edge(canvas: Axes, path: NDArray, lit: bool) -> None:
    """An arrow along a line (N, 2)."""
    colour, width = (SPLINE, 2.0) if lit else (_EDGE, 1.0)
    style: dict[str, Any] = {"linewidth": width, "color": colour, "zorder": width}
    style |= {"arrowstyle": "-|>", "mutation_scale": 9}
    canvas.add_patch(FancyArrowPatch(path=MplPath(path), **style))


def _label_edge(
    canvas: Axes, path: NDArray, actions: Sequence[str], lit: bool, labels: list[NDArray]
) -> None:
    """Actions near the tail of an edge (N, 2), where they are not on other `labels`, their lower
    and upper corners (2, 2), to which they are added."""
    size = np.array([_LETTER * max(map(len, actions)), _LINE * len(actions)])
    boxed, whole = _BOX + _CAPTION, abs(path[-1, 1] - path[0, 1])
    rows = max(1, round((whole + boxed) / _CELL[1]))
    row = ((whole + boxed) / rows - boxed) / whole  # to the next row
    corners = np.zeros((2, 2))
    for share in _LABELS_AT:
        place = path[round(share * row * (len(path) - 1))]
        corners = np.array([place - size / 2, place + size / 2])
        if not any((corners[0] < one[1]).all() and (one[0] < corners[1]).all() for one in labels):
            break
    labels.append(corners)
    style: dict[str, Any] = {"color": INK, "fontsize": 7, "ha": "center", "va": "center"}
    if lit:
        style |= {"color": SPLINE, "weight": "bold"}
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.9}
    x, y = corners.mean(axis=0)
    canvas.text(x, y, "\n".join(actions), bbox=box, zorder=3, **style)


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

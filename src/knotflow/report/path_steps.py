"""What each action of a path leaves for the next: its rates, and the ropes to look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from knotflow.report.paper import Method
from knotflow.report.proposals.pair import draw_panel
from knotflow.report.results import COUNT, NUMBER, TEXT, Results
from knotflow.report.statistics import clustered_rate
from knotflow.report.style import Picture, render
from knotflow.report.tables import NOTHING, markdown_table, percent
from knotflow.viz.style import INK, MUTED, RULE, WIDTH, styled

STEPS = {"start": TEXT, "action": TEXT, "shape": COUNT, "splines": COUNT, "successes": COUNT}
SHAPES = {"start": TEXT, "action": TEXT, "shape": COUNT, "point": COUNT}
SHAPES |= dict.fromkeys("xyz", NUMBER)
ROPE_WIDTH = 1.8  # points, about that of a rope 16 mm thick
# Inches.
LABEL, PAD, TOP, PANEL, GUTTER, BOTTOM = 0.6, 0.07, 0.28, 0.86, 0.1, 0.22


def step_table(results: Results, experiment: str, methods: Sequence[Method]) -> str:
    """A line a start and method: how often each action succeeds; empty where none was tried."""
    found = {method.label: _steps(results, experiment, method.name) for method in methods}
    known = {label: steps for label, steps in found.items() if steps is not None}
    if not known:
        return ""
    everything = pd.concat(known.values())
    actions, starts = (list(dict.fromkeys(everything[key])) for key in ("action", "start"))
    lines = [
        [start, label, *(_cell(steps, start, action) for action in actions)]
        for start in starts
        for label, steps in known.items()
    ]
    header = ["start", "method", *(f"`{action}`" for action in actions)]
    return markdown_table(header, lines, "ll" + "r" * len(actions))


def hardest_steps(results: Results, experiment: str, method: str) -> str:
    """In words, for each start the action that succeeds least from what the one before left; empty
    where none was tried."""
    steps = _steps(results, experiment, method)
    if steps is None:
        return ""
    parts = []
    for start, own in steps.groupby("start", sort=False):
        sums = own.groupby("action", sort=False)[["successes", "splines"]].sum()
        action = (sums["successes"] / sums["splines"]).idxmin()
        cell = _cell(steps, start, action).replace("<br>", ", ")
        parts.append(f"`{action}` from the {start} rope, {cell}")
    return "; ".join(parts)


def left_ropes(
    results: Results, experiment: str, methods: Sequence[Method], name: str
) -> Picture | None:
    """The first ropes that the first action of each method left, as the second one begins with
    them: a row a start; None where there are none."""
    ropes = {method: _left(results, experiment, method.name) for method in methods}
    ropes = {method: left for method, left in ropes.items() if left}
    if not ropes:
        return None
    starts = list(dict.fromkeys(start for left in ropes.values() for start in left))
    most = max(len(own) for left in ropes.values() for own in left.values())
    cell = (WIDTH - LABEL - GUTTER * (len(ropes) - 1)) / (most * len(ropes))
    every = [rope for left in ropes.values() for own in left.values() for rope in own]
    scale = min(
        ((np.array([cell, PANEL]) - 2 * PAD) / np.ptp(rope[:, :2], axis=0)).min() for rope in every
    )
    height = TOP + PANEL * len(starts) + BOTTOM
    with styled():
        figure = Figure(figsize=(WIDTH, height))
        for row, start in enumerate(starts):
            bottom = height - TOP - PANEL * (row + 1)
            figure.text(0, (bottom + PANEL / 2) / height, start, fontsize=8, color=INK, va="center")
            for column, (method, left) in enumerate(ropes.items()):
                x = LABEL + column * (most * cell + GUTTER)
                if row == 0:
                    over = (x + most * cell / 2) / WIDTH
                    figure.text(
                        over, 1, method.label, ha="center", va="top", fontsize=8, color=MUTED
                    )
                for place, rope in enumerate(left.get(start, [])):
                    corner = (x + place * cell) / WIDTH, bottom / height
                    box = (*corner, cell / WIDTH, PANEL / height)
                    middle = np.mean([rope.min(axis=0), rope.max(axis=0)], axis=0)[:2]
                    draw_panel(figure, rope, box, middle, scale, ROPE_WIDTH)
        _scale_bar(figure, scale, height)
        alt = f"{len(every)} ropes that the first action left, by start and method"
        return render(figure, name, alt)


def _steps(results: Results, experiment: str, method: str) -> pd.DataFrame | None:
    key = ("start", "action", "shape")
    return results.table(experiment, f"{method}_steps.csv", STEPS, key=key)


def _cell(steps: pd.DataFrame, start: str, action: str) -> str:
    own = steps[(steps["start"] == start) & (steps["action"] == action)]
    if own.empty:
        return NOTHING
    never = int((own["successes"] == 0).sum())
    rate = percent(clustered_rate(own["successes"], own["splines"]))
    return f"{rate}<br>none from {never} of {len(own)} ropes" if never else rate


def _left(results: Results, experiment: str, method: str) -> dict[str, list[np.ndarray]]:
    """By start, the ropes (V, 3) that the second action begins with."""
    key = ("start", "action", "shape", "point")
    shapes = results.table(experiment, f"{method}_shapes.csv", SHAPES, key=key)
    if shapes is None:
        return {}
    return {
        start: [
            rope.sort_values("point")[["x", "y", "z"]].to_numpy(float)
            for _, rope in own[own["action"] == own["action"].unique()[1]].groupby("shape")
        ]
        for start, own in shapes.groupby("start", sort=False)
        if own["action"].nunique() > 1
    }


def _scale_bar(figure: Figure, scale: float, height: float) -> None:
    """20 cm, below the last row."""
    axes = figure.add_axes((LABEL / WIDTH, 0, 0.2 * scale / WIDTH, BOTTOM / height))
    axes.set_axis_off()
    axes.plot([0, 1], [0.3, 0.3], color=RULE, linewidth=2, solid_capstyle="butt")
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    axes.text(0.5, 0.4, "20 cm", ha="center", va="bottom", fontsize=6.5, color=MUTED)

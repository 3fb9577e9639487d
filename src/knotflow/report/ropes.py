"""Ropes with splines, read and drawn from above; the shipped demonstrations (Sec. V-B a)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Figures, Parts
from knotflow.topology.polyline import Floats
from knotflow.viz.rope import draw_rope
from knotflow.viz.spline import draw_spline, spline_bounds
from knotflow.viz.style import BAD, GOOD, INK, MUTED

ROPE_WIDTH, BANDS = 1.8, 16  # points; of one colour each along a rope
PANEL, WORDS, PAD = 0.95, 0.36, 0.14  # inches
SHARES = {"action": str, "share": float, "room": float, "starts_left_out": int}


@dataclass(frozen=True)
class Rope:
    """A rope (V, 3), metres, and what was proposed for it.

    `splines` are control points (3, 3), metres, and whether the rope ended in the action's state;
    `after` (V, 3) is where the first of them led, None where its simulation diverged.
    """

    action: str
    before: Floats
    splines: tuple[tuple[Floats, bool], ...]
    after: Floats | None


def read_ropes(results: Results, experiment: str, name: str) -> list[Rope]:
    """proposals.csv or a table like it, a row a point.

    Raises:
        ResultsError: a rope is incomplete, or a spline has not three control points.
    """
    key = ("action", "start", "what", "proposal", "point")
    columns = dict.fromkeys((*key, "outcome"), str) | {"point": int} | dict.fromkeys("xyz", float)
    table = results.table(experiment, name, columns, key)
    ropes = []
    for (action, start), own in table.groupby([*key[:2]], sort=False):
        shapes: dict[str, list[tuple[Floats, bool]]] = {"before": [], "spline": [], "after": []}
        for (what, _), rows in own.groupby(["what", "proposal"], sort=False):
            points = rows.sort_values("point")[[*"xyz"]].to_numpy(float)
            shapes.setdefault(str(what), []).append((points, rows["outcome"].iloc[0] == "success"))
        before, splines, after = shapes["before"], shapes["spline"], shapes["after"]
        if not before or not splines or any(len(controls) != 3 for controls, _ in splines):
            raise ResultsError(
                f"{experiment}/{name}: start {start} of {action} needs a rope before and splines "
                "of 3 control points"
            )
        ropes.append(Rope(action, before[0][0], tuple(splines), after[0][0] if after else None))
    return ropes


def sheet(
    figures: Figures,
    name: str,
    caption: str,
    ropes: Sequence[Rope],
    notes: Sequence[str],
    columns: int,
) -> str:
    """A figure of ropes, each with its splines and the rope after the first of them below.

    Green splines succeeded, red and dashed ones did not; the first is thicker. `notes` has a few
    words for each rope.
    """
    rows: list[list[tuple[Rope, str]]] = []
    for action in dict.fromkeys(rope.action for rope in ropes):
        own = [one for one in zip(ropes, notes, strict=True) if one[0].action == action]
        for begin in range(0, len(own), columns):
            part = own[begin : begin + columns]
            if rows and len(rows[-1]) + len(part) <= columns:  # actions share a row if they fit
                rows[-1] += part
            else:
                rows.append(part)
    height = len(rows) * (WORDS + 2 * PANEL)

    def plot(figure: Figure) -> None:
        middle: dict[str, Any] = {"ha": "center", "va": "top"}
        for number, row in enumerate(rows):
            top = 1 - number / len(rows)
            for column, (rope, note) in enumerate(row):
                x = (column + 0.5) / columns
                figure.text(x, top - 0.05 / height, rope.action, fontsize=8, color=INK, **middle)
                figure.text(x, top - 0.2 / height, note, fontsize=6.5, color=MUTED, **middle)
                size = (1 / columns, PANEL / height)
                _draw_rope(figure, rope, (column / columns, top - WORDS / height), size)

    return figures.draw(name, caption, height, plot, layout=None)


def _draw_rope(
    figure: Figure, rope: Rope, corner: tuple[float, float], size: tuple[float, float]
) -> None:
    """The rope with its splines, and the rope after below; both panels show one window."""
    drawn = [rope.before[:, :2], *(np.stack(spline_bounds(spline)) for spline, _ in rope.splines)]
    drawn += [] if rope.after is None else [rope.after[:, :2]]
    low, high = np.vstack(drawn).min(axis=0), np.vstack(drawn).max(axis=0)
    inches = figure.get_size_inches() * size
    scale = float(((inches - PAD) / (high - low)).min())  # inches a metre
    centre, reach = (low + high) / 2, inches / scale / 2
    panels = []
    for row, points in enumerate((rope.before, rope.after), 1):
        axes = figure.add_axes((corner[0], corner[1] - row * size[1], *size))
        axes.set_axis_off()
        axes.set_xlim(centre[0] - reach[0], centre[0] + reach[0])
        axes.set_ylim(centre[1] - reach[1], centre[1] + reach[1])
        if points is None:
            axes.text(
                centre[0], centre[1], "diverged", ha="center", va="center", color=BAD, fontsize=8
            )
        else:
            draw_rope(axes, points, ROPE_WIDTH / 72 / scale, bands=BANDS)
        panels.append(axes)
    for number, (controls, succeeded) in reversed(list(enumerate(rope.splines))):
        draw_spline(
            panels[0], controls, GOOD if succeeded else BAD, linewidth=0.7 if number else 1.2,
            dashed=not succeeded, release="o" if succeeded else "x", zorder=4.0 + (number == 0),
        )  # fmt: skip


def demonstrations(results: Results, figures: Figures) -> Parts:
    """A line an action, and all demonstrations in a figure."""
    shares = results.table("demonstrator", "shares.csv", SHARES)
    rows = [
        {
            "action": f"`{action}`",
            "demonstrations": f"{len(own)}",
            "robustness, mean": f"{own['share'].mean():.2f}",
            "least": f"{own['share'].min():.2f}",
            "room, mean": f"{own['room'].mean():.2f}",
            "starts skipped": f"{own['starts_left_out'].sum()}",
        }
        for action, own in shares.groupby("action", sort=False)
    ]
    return {
        "actions": md.table(rows),
        "sheet": sheet(
            figures,
            "demonstrator",
            "All demonstrations, seen from above: each rope with its spline (green, from dot to "
            "circle), its robustness and room, and below it the rope afterwards. Blue is the head, "
            "orange the tail.",
            read_ropes(results, "demonstrator", "shapes.csv"),
            [f"{one.share:.2f} / {one.room:.2f}" for one in shares.itertuples()],
            columns=8,
        ),
    }

"""All demonstrations at a glance: each rope, its spline, and the rope after it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from knotflow.report.proposals.pair import draw_pair, window
from knotflow.report.proposals.records import Rope
from knotflow.report.style import Picture, render
from knotflow.viz.spline import draw_spline
from knotflow.viz.style import GOOD, INK, MUTED, RULE, WIDTH, styled

ROPE_WIDTH = 2.0  # points, about that of a rope 16 mm thick
COLUMNS = 8
# Inches.
CELL, PAD = WIDTH / COLUMNS, 0.1
PANEL, WORDS = 0.92, 0.34


def contact_sheet(ropes: Sequence[Rope], notes: Sequence[str], name: str) -> Picture:
    """Demonstrations in rows, an action's together: the rope before over the rope after.

    Args:
        ropes: a demonstration each, with one spline.
        notes: a few words for each.
        name: of the picture.
    """
    rows = _rows(ropes)
    tall = WORDS + 2 * PANEL
    with styled():
        figure = Figure(figsize=(WIDTH, tall * len(rows)))
        noted = dict(zip(map(id, ropes), notes, strict=True))
        for number, row in enumerate(rows):
            top = 1 - number / len(rows)
            if number:
                figure.add_artist(Line2D([0, 1], [top, top], color=RULE, linewidth=0.8))
            for column, rope in enumerate(row):
                x = (column + 0.5) / COLUMNS
                height = tall * len(rows)
                words: dict[str, Any] = {"ha": "center", "va": "top"}
                figure.text(x, top - 0.05 / height, rope.action, fontsize=8, color=INK, **words)
                figure.text(
                    x, top - 0.19 / height, noted[id(rope)], fontsize=6.5, color=MUTED, **words
                )
                _pair(figure, rope, column / COLUMNS, top - WORDS / height, PANEL / height)
        actions = len({rope.action for rope in ropes})
        alt = (
            f"{len(ropes)} demonstrations of {actions} topological actions: each rope with its "
            "spline, and below it the rope after"
        )
        return render(figure, name, alt)


def _rows(ropes: Sequence[Rope]) -> list[list[Rope]]:
    """Ropes of one action in one row; actions share a row where they fit."""
    rows: list[list[Rope]] = []
    for action in dict.fromkeys(rope.action for rope in ropes):
        own = [rope for rope in ropes if rope.action == action]
        for begin in range(0, len(own), COLUMNS):
            part = own[begin : begin + COLUMNS]
            if rows and len(rows[-1]) + len(part) <= COLUMNS:
                rows[-1] += part
            else:
                rows.append(part)
    return rows


def _pair(figure: Figure, rope: Rope, left: float, top: float, tall: float) -> None:
    """The rope with its spline, and the rope after below it."""
    low, high = window(rope)
    scale = float(((np.array([CELL, PANEL]) - PAD) / (high - low)).min())  # inches a metre
    upper, lower = ((left, top - row * tall, 1 / COLUMNS, tall) for row in (1, 2))
    before, _ = draw_pair(figure, rope, (upper, lower), scale, ROPE_WIDTH)
    (spline,) = rope.splines
    draw_spline(before, spline.controls, GOOD, linewidth=1.1, release="o")

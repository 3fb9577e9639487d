"""The figure to look at: unseen ropes, the splines proposed for them, and where those led."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from knotflow.report.paper import in_order
from knotflow.report.proposals.pair import draw_pair, window
from knotflow.report.proposals.records import Proposed, Rope
from knotflow.report.style import Picture, render
from knotflow.viz.spline import draw_spline
from knotflow.viz.style import BAD, GOOD, INK, MUTED, RULE, WIDTH, rope_colour, styled

ROPE_WIDTH = 2.4  # points, about that of a rope 16 mm thick
# Inches.
LABEL, CELL, BETWEEN, GUTTER = 0.84, 1.15, 0.06, 0.16
TALLEST, LOWEST, PAD, TOP, BOTTOM = 1.25, 0.72, 0.13, 0.3, 0.34


def proposals(ropes: Sequence[Rope], name: str) -> Picture:
    """A row an action: of each rope the start with its splines, and the shape after the first.

    Green splines succeeded, red and dashed ones did not. A rope's two panels are one window.
    """
    actions = in_order([rope.action for rope in ropes])
    rows = [[rope for rope in ropes if rope.action == action] for action in actions]
    heights = []
    for row in rows:
        tallest = max(_scale(rope) * _size(rope)[1] for rope in row)
        heights.append(max(LOWEST, tallest) + 2 * PAD)
    with styled():
        height = TOP + sum(heights) + BOTTOM
        figure = Figure(figsize=(WIDTH, height))
        top = height - TOP
        _headings(figure, height, max(map(len, rows)))
        for action, row, tall in zip(actions, rows, heights, strict=True):
            _rule(figure, top / height)
            _label(figure, action, row, (top - tall / 2) / height, height)
            for place, rope in enumerate(row):
                left = _left(place)
                _pair(figure, rope, left, top, tall, height)
            top -= tall
        _rule(figure, top / height)
        for place in range(1, max(map(len, rows))):
            x = (_left(place) - GUTTER / 2) / WIDTH
            ends = [top / height, 1 - TOP / height]
            figure.add_artist(Line2D([x, x], ends, color=RULE, linewidth=0.8))
        _key(figure, height)
        tried = sum(len(rope.splines) for rope in ropes)
        hit = sum(spline.succeeded for rope in ropes for spline in rope.splines)
        alt = (
            f"{len(ropes)} unseen ropes of {len(actions)} topological actions with {tried} "
            f"proposed splines, of which {hit} succeeded, and the shapes after the first"
        )
        return render(figure, name, alt)


def _left(place: int) -> float:
    """Inches left of a rope's two panels."""
    return LABEL + place * (2 * CELL + BETWEEN + GUTTER)


def _size(rope: Rope) -> NDArray:
    """Width and height (2,) of what is drawn of a rope, metres."""
    low, high = window(rope)
    return high - low


def _scale(rope: Rope) -> float:
    """Inches a metre."""
    width, height = _size(rope)
    return float(min((CELL - PAD) / width, TALLEST / height))


def _pair(figure: Figure, rope: Rope, left: float, top: float, tall: float, height: float) -> None:
    first, second = (
        (x / WIDTH, (top - tall) / height, CELL / WIDTH, tall / height)
        for x in (left, left + CELL + BETWEEN)
    )
    scale = _scale(rope)
    before, after = draw_pair(figure, rope, (first, second), scale, ROPE_WIDTH)
    _bar(before, scale)
    for number, spline in reversed(list(enumerate(rope.splines))):
        _spline(before, spline, first=number == 0)
    if rope.after is None:
        words = "simulation\nblew up"
        after.text(0.5, 0.5, words, ha="center", va="center", transform=after.transAxes, color=BAD)
    else:
        _verdict(after, rope.splines[0])


def _spline(axes: Axes, spline: Proposed, *, first: bool) -> None:
    draw_spline(
        axes,
        spline.controls,
        GOOD if spline.succeeded else BAD,
        linewidth=1.6 if first else 0.75,
        dashed=not spline.succeeded,
        release="o" if spline.succeeded else "x",
        zorder=4.0 + first,
    )


def _verdict(axes: Axes, spline: Proposed) -> None:
    colour, mark = (GOOD, "✓") if spline.succeeded else (BAD, "✗")
    axes.text(
        0.99,
        0.97,
        mark,
        transform=axes.transAxes,
        ha="right",
        va="top",
        color=colour,
        fontsize=10,
    )


def _headings(figure: Figure, height: float, columns: int) -> None:
    for place in range(columns):
        left = _left(place)
        for x, words in ((left, "start, proposals"), (left + CELL + BETWEEN, "after the first")):
            figure.text(
                (x + CELL / 2) / WIDTH,
                1 - 0.12 / height,
                words,
                ha="center",
                va="top",
                fontsize=8,
                color=MUTED,
            )


def _bar(axes: Axes, scale: float) -> None:
    """A bar of 10 cm in the lower left corner, for every rope has a scale of its own."""
    x, y = axes.get_xlim()[0] + 0.045 / scale, axes.get_ylim()[0] + 0.045 / scale
    axes.plot([x, x + 0.1], [y, y], color=MUTED, linewidth=1.0, clip_on=False)
    axes.text(x + 0.1, y, " 10 cm", va="center", fontsize=5.5, color=MUTED)


def _label(figure: Figure, action: str, row: Sequence[Rope], y: float, height: float) -> None:
    splines = [spline for rope in row for spline in rope.splines]
    hit = sum(spline.succeeded for spline in splines)
    step = 0.08 / height
    figure.text(0.0, y + step, action, va="center", fontsize=9, color=INK)
    figure.text(0.0, y - step, f"{hit} of {len(splines)}", va="center", fontsize=8, color=MUTED)


def _rule(figure: Figure, y: float) -> None:
    figure.add_artist(Line2D([0, 1], [y, y], color=RULE, linewidth=0.8))


def _key(figure: Figure, height: float) -> None:
    handles = [
        Line2D([], [], color=rope_colour(0.0), marker="o", linewidth=ROPE_WIDTH, label="head"),
        Line2D([], [], color=rope_colour(1.0), linewidth=ROPE_WIDTH, label="tail"),
        Line2D(
            [], [], color=GOOD, marker="o", markerfacecolor="none", markersize=4, label="succeeded"
        ),
        Line2D(
            [], [], color=BAD, marker="x", linestyle="--", markersize=4, label="did not succeed"
        ),
        Line2D([], [], color=INK, linewidth=1.6, label="thick: the first, whose result is shown"),
    ]
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.0, 0.02 / height),
        ncols=len(handles),
        frameon=False,
        fontsize=8,
        handlelength=1.9,
        columnspacing=1.6,
        borderaxespad=0.0,
    )

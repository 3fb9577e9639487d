"""Fig. 8 made again, and the training curves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from knotflow.report.causal_infogan.records import CURVES, MODELS, PanelRow, Training
from knotflow.report.style import (
    INK,
    MUTED,
    PAPER,
    WIDTH,
    Picture,
    bare_axis,
    new_figure,
    render,
    styled,
)

#: Head blue, tail orange, as in the paper's Fig. 9; both are legible on light and dark.
ROPE = LinearSegmentedColormap.from_list("rope", ["#0072b2", "#56b4e9", "#e69f00", "#d55e00"])
PIECES = 8
COLOURS = {"single": "#0072b2", "all": "#e69f00"}
NAMES = {
    "spread": "spread of shapes",
    "starts_covered": "demonstrated starts covered",
    "code_used": "share of the code read back",
    "distance_to_data": "distance to the data, mm",
}


def panel(rows: Sequence[PanelRow], name: str) -> Picture:
    """Fig. 8: a row a plan; given, projected, way points, projected, given, from left to right."""
    columns = max(len(row.roles) for row in rows)
    with styled():
        figure = new_figure(WIDTH / columns * (len(rows) + 0.55))
        grid = figure.subplots(len(rows), columns, squeeze=False)
        for axes in grid.flat:
            axes.set_axis_off()
        for line, row in zip(grid, rows, strict=True):
            middle = row.points[..., :2].reshape(-1, 2)
            centre = (middle.max(axis=0) + middle.min(axis=0)) / 2
            reach = 1.12 * np.abs(middle - centre).max()
            for axes, points in zip(line, row.points, strict=False):
                axes.set_xlim(centre[0] - reach, centre[0] + reach)
                axes.set_ylim(centre[1] - reach, centre[1] + reach)
                axes.set_aspect("equal")
                _draw_rope(axes, points)
            told = f"{row.goal}\n{row.shapes}"
            line[0].text(
                -0.06,
                0.5,
                told,
                rotation=90,
                ha="right",
                va="center",
                multialignment="center",
                fontsize=7,
                color=MUTED,
                transform=line[0].transAxes,
            )
        for axes, role in zip(grid[0], rows[0].roles, strict=False):
            axes.set_title(role.replace(" ", "\n", 1), fontsize=7.5, color=INK)
        alt = f"Plans of rope shapes by Causal InfoGAN: {len(rows)} rows, {columns} shapes each"
        return render(figure, name, alt)


def curves(points: Sequence[Training], name: str) -> Picture:
    """Training curves, a line a seed; below the dotted line at the end a training has collapsed."""
    with styled():
        figure = new_figure(2.5)
        for axes, quantity in zip(figure.subplots(1, len(NAMES)), NAMES, strict=True):
            scale = 1000 if quantity == "distance_to_data" else 1
            for model in MODELS:
                own = [point for point in points if point.model == model]
                for seed in sorted({point.seed for point in own}):
                    line = [point for point in own if point.seed == seed]
                    axes.plot(
                        [point.step for point in line],
                        [scale * getattr(point, quantity) for point in line],
                        color=COLOURS[model],
                        linewidth=1.1,
                        alpha=0.85,
                        label=MODELS[model] if seed == own[0].seed else None,
                    )
            if quantity in CURVES:
                axes.axhline(CURVES[quantity], color=INK, linewidth=0.8, linestyle=":")
                axes.set_ylim(0, max(1.15, axes.get_ylim()[1]))
            else:
                axes.set_ylim(0, None)
            axes.set_title(NAMES[quantity], fontsize=8.5, color=INK)
            axes.set_xlabel("gradient steps")
            axes.tick_params(axis="x", labelsize=7)
            axes.locator_params(axis="x", nbins=4)
            bare_axis(axes, grid="y")
        figure.axes[0].legend(frameon=False, fontsize=7.5, loc="lower right")
        models = len({(point.model, point.seed) for point in points})
        return render(figure, name, f"Training curves of {models} Causal InfoGAN models")


def _draw_rope(axes: Axes, points: NDArray) -> None:
    """A rope (V, 3) seen from above; at crossings the upper strand is cased."""
    flat, links = points[:, :2], len(points) - 1
    for first, last in zip(*_pieces(links), strict=True):
        colour = ROPE((first + last) / 2 / links)
        axes.plot(*flat[first : last + 1].T, color=colour, linewidth=2, solid_capstyle="round")
    for over in _over_links(points):
        bridge = flat[over : over + 2]
        axes.plot(*bridge.T, color=PAPER, linewidth=4.5, solid_capstyle="butt", zorder=3)
        axes.plot(
            *bridge.T, color=ROPE(over / links), linewidth=2, solid_capstyle="round", zorder=4
        )
    axes.plot(*flat[0], "o", color=ROPE(0.0), markersize=3, zorder=5)


def _pieces(links: int) -> tuple[list[int], list[int]]:
    bounds = np.linspace(0, links, PIECES + 1).round().astype(int).tolist()
    return bounds[:-1], bounds[1:]


def _over_links(points: NDArray) -> list[int]:
    """Links (of a rope (V, 3)) that pass over another one."""
    start, step = points[:-1], np.diff(points, axis=0)
    offset = start[None, :, :2] - start[:, None, :2]  # (L, L, 2) from link i to link j
    one, other = step[:, None, :2], step[None, :, :2]
    turn = _cross(one, other)
    safe = np.where(turn == 0, 1, turn)
    along, across = _cross(offset, other) / safe, _cross(offset, one) / safe
    meet = (turn != 0) & (along > 0) & (along < 1) & (across > 0) & (across < 1)
    apart = np.abs(np.subtract.outer(np.arange(len(step)), np.arange(len(step)))) > 1
    height = start[:, None, 2] + along * step[:, None, 2]
    below = start[None, :, 2] + across * step[None, :, 2]
    return np.unique(np.argwhere(meet & apart & (height > below))[:, 0]).tolist()


def _cross(a: NDArray, b: NDArray) -> NDArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

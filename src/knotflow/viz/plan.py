"""The picture of a plan, after Fig. 9: each rope shape with the spline that is executed next."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from knotflow.planning.plan import KnotPlan
from knotflow.simulation import spline_path
from knotflow.viz.rope import draw_rope
from knotflow.viz.spline import draw_spline, spline_bounds
from knotflow.viz.style import INK, MUTED, PAPER, SPLINE, WIDTH, save_figure, styled

_MAX_COLUMNS, _MIN_COLUMNS = 4, 3
_MAX_ASPECT = 1.25  # height of a panel in its width
_GUTTER = 0.12  # inches between panels
_HEADER, _CAPTION = 0.38, 0.44  # inches above and below a panel
_LINE, _MARGIN = 0.17, 0.12  # inches: a line of the footer, the figure's edge
_LETTERS = 120  # in a line of the footer
_PAD = 0.02  # metres round everything in a panel
_BAR = 0.1  # metres

_LEGEND = (
    "Rope: head blue with a ring, tail orange.  ● grasp,  ▶ release,  cm: highest point between."
)


def draw_plan(plan: KnotPlan, path: Path) -> None:
    """Draw the start with the first spline, and each resulting rope with the next one.

    Ropes go from blue (head) to orange (tail) at their true thickness, with gaps where a strand
    passes under. Each panel is filled by its rope and has its own scale bar. An unsolved plan is
    drawn as far as it came and says so.

    Args:
        plan: the plan, with or without trajectories.
        path: of the picture; its suffix (png, svg, pdf) sets the format.
    """
    with styled():
        save_figure(plan_figure(plan), path)


def plan_figure(plan: KnotPlan) -> Figure:
    """The figure of `draw_plan`; call it within `viz.style.styled()`."""
    count = len(plan.shapes)
    rows = -(-count // _MAX_COLUMNS)
    columns = -(-count // rows)
    panel = (WIDTH - 2 * _MARGIN) / max(columns, _MIN_COLUMNS) - _GUTTER
    corners = np.array([_bounds(plan, index) for index in range(count)])  # low and high, metres
    sizes = corners[:, 1] - corners[:, 0]
    scales = panel / np.maximum(sizes[:, 0], sizes[:, 1] / _MAX_ASPECT)  # inches a metre
    heights = [max(scales[i : i + columns] * sizes[i : i + columns, 1])
               for i in range(0, count, columns)]  # fmt: skip
    facts = f"{plan.goal}: {plan.branches} branches, {plan.seconds:.1f} s"
    if not plan.solved:
        facts += f"; {plan.reason}"
    footer = textwrap.wrap(facts, _LETTERS)
    height = sum(heights) + rows * (_HEADER + _CAPTION) + _LINE * (len(footer) + 1) + 2 * _MARGIN
    figure = Figure(figsize=(WIDTH, height))
    canvas = figure.add_axes((0, 0, 1, 1), xlim=(0, WIDTH), ylim=(0, height))  # in inches
    canvas.axis("off")
    left = (WIDTH - columns * (panel + _GUTTER) + _GUTTER) / 2
    for index, (low, high) in enumerate(corners):
        row, column = divmod(index, columns)
        x = left + column * (panel + _GUTTER)
        top = height - sum(heights[:row]) - row * (_HEADER + _CAPTION) - _HEADER
        y, scale = top - heights[row], float(scales[index])
        inside = canvas.inset_axes((x, y, panel, heights[row]), transform=canvas.transData)
        inside.axis("off")
        half = np.array([panel, heights[row]]) / scale / 2
        (west, south), (east, north) = (low + high) / 2 - half, (low + high) / 2 + half
        inside.set(xlim=(west, east), ylim=(south, north))
        draw_rope(inside, plan.shapes[index], 2.0 * plan.radius)
        title, colour = ("tied" if plan.solved else "search stopped here"), INK
        if index < len(plan.steps):
            title, colour = f"{index + 1}.  {plan.steps[index].action}", SPLINE
            draw_spline(inside, plan.controls[index], dashed=True)
            _draw_height(inside, plan.controls[index])
        middle = x + panel / 2
        canvas.text(middle, top + 0.12, title, ha="center", color=colour, weight="bold")
        bar = np.array([-0.5, 0.5]) * _BAR * scale + middle
        canvas.plot(bar, [y - 0.12] * 2, color=MUTED, linewidth=1.2)
        canvas.text(bar[1], y - 0.12, "  10 cm", color=MUTED, fontsize=6.5, va="center")
        state = str(plan.states[index])
        label, size = state if index else f"start: {state}", 8 if len(state) < 26 else 6.5
        canvas.text(middle, y - 0.22, label, ha="center", va="top", color=MUTED, fontsize=size)
    for line, text in enumerate([_LEGEND, *footer[::-1]]):
        colour = INK if line else MUTED
        canvas.text(_MARGIN, _MARGIN + line * _LINE, text, color=colour, fontsize=8)
    return figure


def _bounds(plan: KnotPlan, index: int) -> NDArray[np.float64]:
    """Lower and upper corner (2, 2) of a panel, metres."""
    flat = plan.shapes[index][:, :2]
    if index < len(plan.steps):
        flat = np.concatenate((flat, spline_bounds(plan.controls[index])))
    return np.array([flat.min(axis=0) - _PAD, flat.max(axis=0) + _PAD])


def _draw_height(axes: Axes, controls: NDArray) -> None:
    """The gripper's greatest height, beside its highest point, on the outer side of its path."""
    path = spline_path(controls, np.linspace(0.0, 1.0, 60))
    highest = path[path[:, 2].argmax()]
    outward = controls[1, :2] - (controls[0, :2] + controls[2, :2]) / 2
    outward /= max(float(np.linalg.norm(outward)), 1e-9)
    axes.annotate(
        f"{highest[2] * 100:.0f} cm",
        xy=tuple(highest[:2]),
        xytext=(20 * outward[0], 11 * outward[1]),
        textcoords="offset points",
        ha="center",
        va="center",
        color=SPLINE,
        fontsize=7,
        zorder=5,
        path_effects=[withStroke(linewidth=2.5, foreground=PAPER)],
    )

"""The picture of a plan, after Fig. 9: each rope shape with the spline that is executed next."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from knotflow.planning.plan import KnotPlan
from knotflow.simulation import spline_path
from knotflow.viz.palette import INK, MUTED, PAPER, SPLINE
from knotflow.viz.rope import draw_rope
from knotflow.viz.spline import draw_spline, spline_bounds
from knotflow.viz.style import PNG_DPI, WIDTH, styled

_MOST_COLUMNS, _FEWEST_COLUMNS = 4, 3
_TALLEST = 1.25  # of a panel's width: its height at most
_BETWEEN = 0.12  # inches between panels
_HEADER, _CAPTION = 0.38, 0.44  # inches: above and below a panel
_LINE, _MARGIN = 0.17, 0.12  # inches: a line of the footer, the figure's edge
_LETTERS = 120  # in a line of the footer
_PAD = 0.02  # metres round everything in a panel
_BAR = 0.1  # metres

_HALO = [withStroke(linewidth=2.5, foreground=PAPER)]
_KEY = "Rope: head blue with a ring, tail orange.  ● grasp,  ▶ release,  cm: highest point between."


def draw_plan(plan: KnotPlan, path: Path) -> None:
    """Draw the start with the first spline, and each resulting rope with the next one.

    Ropes go from blue (head) to orange (tail) at their true thickness, with gaps where a strand
    passes under. Each panel is filled by its rope and has its own scale bar. A plan that is not
    solved is drawn as far as it came and says so.

    Args:
        plan: the plan, with or without trajectories.
        path: of the picture; its suffix (png, svg, pdf) sets the format.
    """
    # An SVG with its date would change each time it is drawn.
    metadata = {"Date": None} if Path(path).suffix == ".svg" else {}
    with styled():
        plan_figure(plan).savefig(path, dpi=PNG_DPI, metadata=metadata)


@dataclass(frozen=True, eq=False)
class _Window:
    """What a panel shows: its lower corner (2,) and its size (2,), metres."""

    low: NDArray[np.float64]
    size: NDArray[np.float64]

    def scale(self, panel: float) -> float:
        """Inches a metre in a panel of a width in inches."""
        return float(panel / max(self.size[0], self.size[1] / _TALLEST))


def plan_figure(plan: KnotPlan) -> Figure:
    """The figure of `draw_plan`; call it within `drawing.style.styled()`."""
    windows = [_window(plan, index) for index in range(len(plan.shapes))]
    rows = -(-len(windows) // _MOST_COLUMNS)
    columns = -(-len(windows) // rows)
    panel = (WIDTH - 2 * _MARGIN) / max(columns, _FEWEST_COLUMNS) - _BETWEEN
    tall = [
        max(window.scale(panel) * float(window.size[1]) for window in row)
        for row in (windows[i : i + columns] for i in range(0, len(windows), columns))
    ]
    footer = _footer(plan)
    height = sum(tall) + rows * (_HEADER + _CAPTION) + _LINE * len(footer) + 2 * _MARGIN
    figure = Figure(figsize=(WIDTH, height))
    left = (WIDTH - columns * (panel + _BETWEEN) + _BETWEEN) / 2
    for index, window in enumerate(windows):
        row, column = divmod(index, columns)
        top = height - sum(tall[:row]) - row * (_HEADER + _CAPTION) - _HEADER
        x, y = left + column * (panel + _BETWEEN), top - tall[row]
        scale = window.scale(panel)
        axes = figure.add_axes((x / WIDTH, y / height, panel / WIDTH, tall[row] / height))
        axes.axis("off")
        middle, reach = window.low + window.size / 2, np.array([panel, tall[row]]) / scale / 2
        axes.set(
            xlim=(middle[0] - reach[0], middle[0] + reach[0]),
            ylim=(middle[1] - reach[1], middle[1] + reach[1]),
        )
        draw_rope(axes, plan.shapes[index], 2.0 * plan.radius)
        if index < len(plan.steps):
            draw_spline(axes, plan.controls[index], dashed=True)
            _height(axes, plan.controls[index])
        below = figure.add_axes(
            (x / WIDTH, (y - _CAPTION) / height, panel / WIDTH, _CAPTION / height)
        )
        below.axis("off")
        below.set(xlim=(0, panel), ylim=(-_CAPTION, 0))
        _caption(below, str(plan.states[index]), panel, scale, first=index == 0)
        _title(figure, plan, index, (x + panel / 2) / WIDTH, (top + 0.12) / height)
    for line, (text, colour) in enumerate(reversed(footer)):
        place = (_MARGIN / WIDTH, (_MARGIN + line * _LINE) / height)
        figure.text(*place, text, color=colour, fontsize=8)
    return figure


def _window(plan: KnotPlan, index: int) -> _Window:
    places = [plan.shapes[index][:, :2]]
    if index < len(plan.steps):
        places.append(np.array(spline_bounds(plan.controls[index])))
    flat = np.concatenate(places)
    low, high = flat.min(axis=0) - _PAD, flat.max(axis=0) + _PAD
    return _Window(low, high - low)


def _height(axes: Axes, controls: NDArray) -> None:
    """How high the gripper goes, beside the highest place of its path, on its outer side."""
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
        path_effects=_HALO,
    )


def _caption(axes: Axes, state: str, width: float, scale: float, *, first: bool) -> None:
    """A scale bar and the state; the axes are in inches, `scale` in inches a metre."""
    half, y = _BAR * scale / 2, -0.12
    axes.plot([width / 2 - half, width / 2 + half], [y, y], color=MUTED, linewidth=1.2)
    axes.text(width / 2 + half, y, "  10 cm", color=MUTED, fontsize=6.5, va="center")
    axes.text(
        width / 2,
        -0.22,
        f"start: {state}" if first else state,
        ha="center",
        va="top",
        color=MUTED,
        fontsize=8 if len(state) < 26 else 6.5,
    )


def _title(figure: Figure, plan: KnotPlan, index: int, x: float, y: float) -> None:
    """The action that comes next, or how the plan ends; place in shares of the figure."""
    if index < len(plan.steps):
        title, colour = f"{index + 1}.  {plan.steps[index].action}", SPLINE
    else:
        title, colour = ("tied" if plan.solved else "search stopped here"), INK
    figure.text(x, y, title, ha="center", color=colour, weight="bold")


def _footer(plan: KnotPlan) -> list[tuple[str, str]]:
    """Lines and their colours: the goal, the size of the search, and what the marks mean."""
    facts = f"{plan.goal}: {plan.branches} branches, {plan.seconds:.1f} s"
    if not plan.solved:
        facts += f"; {plan.reason}"
    return [*((line, INK) for line in textwrap.wrap(facts, _LETTERS)), (_KEY, MUTED)]

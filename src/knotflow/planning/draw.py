"""The picture of a plan, after Fig. 9: each rope shape with the spline that is executed next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from knotflow.planning.pictures import INK, MUTED, RULE, SPLINE, draw_ribbon, ribbon, styled
from knotflow.planning.plan import KnotPlan
from knotflow.simulation import spline_path
from knotflow.topology import project

_PER_ROW = 4
_PANEL = 2.75  # inches, width of a panel
_LENS = 2.1  # inches, side of a close-up
_HEADER, _CAPTION, _FOOTER = 0.38, 0.34, 0.42  # inches: above and below a panel, below all
_PAD = 0.05  # metres round everything in a panel
_LENS_PAD = 0.03  # metres round the crossings in a close-up
_DPI = 150

_HALO = [withStroke(linewidth=2.5, foreground="white")]


def draw_plan(plan: KnotPlan, path: Path) -> None:
    """Draw the start, each spline with its control polygon, and each resulting rope.

    Ropes go from blue (head) to orange (tail), with gaps where a strand passes under. All panels
    have one scale; below a rope with crossings stands a close-up of them. A plan that is not
    solved is drawn as far as it came and says so.

    Args:
        plan: the plan, with or without trajectories.
        path: of the picture; its ending (png, svg, pdf) tells the format.
    """
    with styled():
        plan_figure(plan).savefig(path, dpi=_DPI)


def plan_figure(plan: KnotPlan) -> Figure:
    """The figure of `draw_plan`; call it within `pictures.styled()`."""
    shapes, controls = plan.shapes, plan.controls
    windows = [_window(shape, controls[i : i + 1]) for i, shape in enumerate(shapes)]
    size = np.max([high - low for low, high in windows], axis=0)  # metres, of every panel
    size[1] = max(size[1], size[0] / 5)
    scale = _PANEL / size[0]  # inches a metre
    panel_height = float(size[1]) * scale
    columns = min(_PER_ROW, len(shapes))
    rows = -(-len(shapes) // columns)
    row_height = _HEADER + panel_height + _LENS + _CAPTION
    width, height = max(2, columns) * _PANEL, rows * row_height + _FOOTER
    figure = Figure(figsize=(width, height))
    for index, (points, (low, high)) in enumerate(zip(shapes, windows, strict=True)):
        row, column = divmod(index, columns)
        left, top = column * _PANEL, height - row * row_height - _HEADER
        middle = (low + high) / 2
        axes = _axes(figure, (left, top - panel_height), (_PANEL, panel_height))
        _show(axes, plan, index, middle, size, scale)
        lens = _crossing_window(points)
        if lens is not None:
            corner, side = lens
            axes.add_patch(
                Rectangle(tuple(corner), side, side, fill=False, edgecolor=MUTED, linewidth=0.6)
            )
            place = (left + (_PANEL - _LENS) / 2, top - panel_height - _LENS)
            close = _axes(figure, place, (_LENS, _LENS))
            _show(close, plan, index, corner + side / 2, np.array([side, side]), _LENS / side)
            close.add_patch(
                Rectangle(
                    (0, 0), 1, 1, transform=close.transAxes, fill=False, edgecolor=RULE, linewidth=1
                )
            )
        _label(figure, plan, index, left + _PANEL / 2, (top, top - panel_height - _LENS))
    _draw_footer(figure, plan, scale)
    return figure


def _axes(figure: Figure, corner: tuple[float, float], size: tuple[float, float]) -> Axes:
    """Axes at a place in inches."""
    width, height = figure.get_size_inches()
    axes = figure.add_axes(
        (corner[0] / width, corner[1] / height, size[0] / width, size[1] / height)
    )
    axes.axis("off")
    return axes


def _show(
    axes: Axes, plan: KnotPlan, index: int, middle: NDArray, size: NDArray, scale: float
) -> None:
    """One rope and the next spline in a window of a size in metres; scale in inches a metre."""
    low, high = middle - size / 2, middle + size / 2
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    width = 2.0 * plan.radius
    draw_ribbon(axes, ribbon(plan.shapes[index], width), width * scale * 72.0)
    if index < len(plan.steps):
        _draw_spline(axes, plan.controls[index])


def _draw_spline(axes: Axes, controls: NDArray) -> None:
    path = spline_path(controls, np.linspace(0.0, 1.0, 60))
    axes.plot(*controls[:, :2].T, color=SPLINE, linewidth=0.8, alpha=0.6, zorder=3)
    axes.plot(*path[:, :2].T, color="white", linewidth=3.2, alpha=0.75, zorder=3.1)
    axes.plot(*path[:-3, :2].T, color=SPLINE, linewidth=1.8, dashes=(3.2, 1.6), zorder=3.2)
    axes.annotate(
        "",
        xy=tuple(path[-1, :2]),
        xytext=tuple(path[-5, :2]),
        arrowprops={"arrowstyle": "-|>", "color": SPLINE, "linewidth": 1.4, "shrinkB": 0.0},
        zorder=3.3,
        annotation_clip=True,
    )
    grasp, middle = controls[0, :2], controls[1, :2]
    axes.plot(*grasp, "o", color=SPLINE, markeredgecolor="white", markersize=7, zorder=3.4)
    axes.plot(*middle, "s", color="white", markeredgecolor=SPLINE, markersize=4.5, zorder=3.4)
    axes.annotate(
        f"{controls[1, 2] * 100:.0f} cm",
        xy=tuple(middle),
        xytext=(5, 5),
        textcoords="offset points",
        color=SPLINE,
        fontsize=7,
        zorder=3.5,
        path_effects=_HALO,
        annotation_clip=True,
    )


def _label(
    figure: Figure, plan: KnotPlan, index: int, middle: float, ends: tuple[float, float]
) -> None:
    """The action above a panel and the state below it; places in inches."""
    width, height = figure.get_size_inches()
    if index < len(plan.steps):
        title, colour = f"{index + 1}.  {plan.actions[index]}", SPLINE
    else:
        title, colour = ("tied" if plan.solved else "search stopped here"), INK
    figure.text(
        middle / width,
        (ends[0] + 0.1) / height,
        title,
        ha="center",
        color=colour,
        weight="bold",
    )
    state = str(plan.states[index])
    figure.text(
        middle / width,
        (ends[1] - 0.08) / height,
        f"start: {state}" if index == 0 else state,
        ha="center",
        va="top",
        color=MUTED,
        fontsize=8 if len(state) < 30 else 6.5,
    )


def _draw_footer(figure: Figure, plan: KnotPlan, scale: float) -> None:
    """A scale bar, what the marks mean, and the size of the search."""
    width, height = figure.get_size_inches()
    axes = _axes(figure, (0.0, 0.0), (float(width), _FOOTER))
    axes.set(xlim=(0, width), ylim=(0, _FOOTER))
    y = 0.16
    axes.plot([0.15, 0.15 + 0.2 * scale], [y, y], color=INK, linewidth=1.5)
    axes.text(0.23 + 0.2 * scale, y, "0.2 m", color=MUTED, fontsize=8, va="center")
    goal = plan.goal if len(plan.goal) < 40 else plan.goal[:37] + "..."
    facts = f"{goal}: {plan.branches} branches, {plan.seconds:.1f} s"
    if not plan.solved:
        facts += f"\n{plan.reason}"  # beside the scale bar there is no room for one line
    axes.text(width - 0.15, y, facts, color=INK, fontsize=8, va="center", ha="right")
    if len(plan.shapes) > 2 and plan.solved:
        legend = "head blue, tail orange  ·  ● grasp   □ middle point and its height   ▶ release"
        axes.text(1.1 + 0.2 * scale, y, legend, color=MUTED, fontsize=7, va="center")


def _window(points: NDArray, controls: NDArray) -> tuple[NDArray, NDArray]:
    """Lower and upper corner (2,) of a rope, its next spline and the close-up's frame, metres."""
    places = np.concatenate((points[:, :2], controls[..., :2].reshape(-1, 2)))
    if (lens := _crossing_window(points)) is not None:
        places = np.concatenate((places, [lens[0], lens[0] + lens[1]]))
    return places.min(axis=0) - _PAD, places.max(axis=0) + _PAD


def _crossing_window(points: NDArray) -> tuple[NDArray, float] | None:
    """Lower corner (2,) and side of a square round the part of a rope between its crossings."""
    crossings = project(points)
    if not crossings.state.num_crossings:
        return None
    steps = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    along = steps / steps[-1]
    inner = (along >= crossings.fractions[0]) & (along <= crossings.fractions[-1])
    places = np.concatenate((points[inner, :2], crossings.xy))
    low, high = places.min(axis=0), places.max(axis=0)
    side = float((high - low).max()) + 2 * _LENS_PAD
    return (low + high - side) / 2, side

"""The gripper's path over the table: four cubic Bezier curves, as SVG and PDF know them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from knotflow.viz.style import PAPER, SPLINE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

_DASHES = (0.0, (3.2, 1.6))


def spline_bounds(controls: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper corner (2,) of the curve with control points (3, 2 or 3), from above."""
    box = _curve(controls).get_extents()
    return np.array(box.min), np.array(box.max)


def draw_spline(
    axes: Axes,
    controls: NDArray,
    colour: str = SPLINE,
    *,
    linewidth: float = 1.8,
    dashed: bool = False,
    release: Literal["arrow", "o", "x"] = "arrow",
    zorder: float = 4.0,
) -> None:
    """Draw the spline with control points (3, 2 or 3), metres: a dot at the grasp, then the curve.

    The marks grow with the `linewidth`, points; `release` is the one at the end.
    """
    from matplotlib.patches import FancyArrowPatch, PathPatch
    from matplotlib.patheffects import Normal, withStroke

    line: dict[str, Any] = {"edgecolor": colour, "linewidth": linewidth, "capstyle": "butt"}
    if dashed:
        line["linestyle"] = _DASHES
    if release == "arrow":
        casing = withStroke(linewidth=linewidth + 1.4, foreground=PAPER, alpha=0.75)
        line["path_effects"] = [casing, Normal()]
    axes.add_patch(PathPatch(_curve(controls), fill=False, clip_on=False, zorder=zorder, **line))
    grasp, middle, end = np.asarray(controls)[:, :2]
    marks: dict[str, Any] = {"color": colour, "clip_on": False, "zorder": zorder + 0.1}
    if release == "arrow":
        axes.plot(*grasp, "o", markersize=3.6 * linewidth, markeredgecolor=PAPER, **marks)
        tail = end - 1e-3 * (end - middle)  # the curve ends in the direction of its last leg
        marks |= {"arrowstyle": "-|>,head_width=2.1,head_length=4.2", "shrinkA": 0, "shrinkB": 0}
        arrow = FancyArrowPatch(tuple(tail), tuple(end), mutation_scale=linewidth, **marks)
        axes.add_patch(arrow)
        return
    axes.plot(*grasp, "o", markersize=1.4 + 0.75 * linewidth, **marks)
    marks |= {"markerfacecolor": "none", "markeredgewidth": 0.35 + 0.47 * linewidth}
    axes.plot(*end, release, markersize=1.2 + 1.9 * linewidth, **marks)


def _curve(controls: NDArray) -> Path:
    from matplotlib.path import Path

    grasp, middle, end = np.asarray(controls)[:, :2]
    knots = np.array([grasp, grasp, grasp, middle, end, end, end])
    # A segment of the uniform cubic B-spline through four control points, as a Bezier curve.
    first, second = (2 * knots[1:-2] + knots[2:-1]) / 3, (knots[1:-2] + 2 * knots[2:-1]) / 3
    last = (knots[1:-2] + 4 * knots[2:-1] + knots[3:]) / 6
    vertices = np.concatenate([[grasp], np.stack([first, second, last], axis=1).reshape(-1, 2)])
    return Path(vertices, [Path.MOVETO] + [Path.CURVE4] * 12)

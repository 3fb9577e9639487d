"""Ropes in panels: one, or one before and after a spline, in two panels of one window."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from knotflow.report.proposals.records import Rope
from knotflow.viz.rope import draw_rope
from knotflow.viz.spline import spline_bounds

BANDS = 16  # of one colour each along a rope

Box = tuple[float, float, float, float]
"""A panel's left, bottom, width and height, as shares of its figure's."""


def window(rope: Rope) -> tuple[NDArray, NDArray]:
    """The lowest and highest x and y (2,) of all that is drawn of a rope, metres."""
    parts: list[ArrayLike] = [rope.before[:, :2]]
    parts += [spline_bounds(spline.controls) for spline in rope.splines]
    if rope.after is not None:
        parts.append(rope.after[:, :2])
    flat = np.vstack(parts)
    return flat.min(axis=0), flat.max(axis=0)


def draw_pair(
    figure: Figure, rope: Rope, boxes: tuple[Box, Box], scale: float, thick: float
) -> list[Axes]:
    """Two panels: the rope before, and after, empty where its simulation blew up.

    Args:
        figure: takes the panels.
        rope: what is drawn, its splines left to the caller.
        boxes: of the panels; both are of one size.
        scale: inches a metre.
        thick: width of the drawn rope, points.
    """
    middle = np.mean(window(rope), axis=0)
    return [
        draw_panel(figure, points, box, middle, scale, thick)
        for box, points in zip(boxes, (rope.before, rope.after), strict=True)
    ]


def draw_panel(
    figure: Figure,
    points: NDArray | None,
    box: Box,
    middle: NDArray,
    scale: float,
    thick: float,
) -> Axes:
    """A panel without a frame, with a rope (V, 3) in it where there is one.

    Args:
        figure: takes the panel.
        points: of the rope, metres.
        box: of the panel.
        middle: (2,) metres, what the panel's middle shows.
        scale: inches a metre.
        thick: width of the drawn rope, points.
    """
    axes = figure.add_axes(box)
    axes.set_axis_off()
    reach = figure.get_size_inches() * box[2:] / scale / 2
    axes.set_xlim(middle[0] - reach[0], middle[0] + reach[0])
    axes.set_ylim(middle[1] - reach[1], middle[1] + reach[1])
    if points is not None:
        draw_rope(axes, points, thick / 72 / scale, bands=BANDS)
    return axes

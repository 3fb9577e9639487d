"""Pictures of knots to choose from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from knotflow.topology import knot
from knotflow.topology.draw import draw
from knotflow.viz.rope import draw_rope

_WIDTH = 0.02  # metres, of a rope of one metre: thick enough to see in a small picture


@lru_cache
def knot_picture(name: str) -> NDArray[np.uint8]:
    """A knot's diagram (300, 600, 3) by its name, one of `KNOT_NAMES`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    points = draw(max(knot(name)))
    figure = Figure(figsize=(4, 2), dpi=150)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_axis_off()
    axes.set_aspect("equal")
    low, high = points[:, :2].min(axis=0) - _WIDTH, points[:, :2].max(axis=0) + _WIDTH
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    draw_rope(axes, points, _WIDTH)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()

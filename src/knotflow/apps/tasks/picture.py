"""A rope from above as an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def picture(points: NDArray, radius: float, reach: float = 0.7) -> NDArray[np.uint8]:
    """The table of +-`reach` metres with a rope (V, 3) of a radius in metres: (480, 480, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from knotflow.viz.rope import draw_rope

    figure = Figure(figsize=(4.8, 4.8), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.axis("off")
    draw_rope(axes, points, 2 * radius)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()

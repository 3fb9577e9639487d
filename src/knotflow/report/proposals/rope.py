"""A rope drawn as a knot diagram: blue head, orange tail, a gap in whatever passes below."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

#: From head to tail; legible on light and on dark, and told apart by the colour-blind.
COLOURS = LinearSegmentedColormap.from_list("rope", ["#0969da", "#58a6ff", "#f0b072", "#ee7f10"])
LINKS_A_COLOUR = 4
#: Sine below which a gap grows no longer: strands that nearly run along each other.
SHALLOWEST = 0.5


def draw_rope(axes: Axes, points: NDArray, width: float, metre: float) -> None:
    """Draw a rope (V, 3), metres, from above.

    `width` is that of the line in points, `metre` the length of a metre on the figure in points.
    """
    links = len(points) - 1
    link = float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).mean())
    hidden = []
    for _, under, sine in crossings(points):
        # Half the upper strand, a little light beside it, and the round cap of the lower strand.
        half = (0.5 + 0.3 + 0.5) * width / metre / link / max(sine, SHALLOWEST)
        hidden.append((under - half, under + half))
    strokes, colours = [], []
    for first in range(0, links, LINKS_A_COLOUR):
        last = min(first + LINKS_A_COLOUR, links)
        for low, high in visible(first, last, hidden):
            inside = np.arange(np.floor(low) + 1, np.ceil(high))
            strokes.append(_at(points, np.concatenate([[low], inside, [high]])))
            colours.append(COLOURS((first + last) / 2 / links))
    axes.add_collection(
        LineCollection(
            strokes,
            colors=colours,
            linewidths=width,
            capstyle="round",
            joinstyle="round",
            clip_on=False,
        )
    )
    axes.plot(
        *points[0, :2], "o", color=COLOURS(0.0), markersize=1.9 * width, zorder=3, clip_on=False
    )


def crossings(points: NDArray) -> list[tuple[float, float, float]]:
    """Where a rope (V, 3) seen from above crosses itself.

    Returns:
        For each crossing where along the rope the upper and where the lower strand passes, in
        links from the head, and the sine of the angle between them.
    """
    start, step = points[:-1], np.diff(points, axis=0)
    offset = start[None, :, :2] - start[:, None, :2]  # (L, L, 2) from link i to link j
    one, other = step[:, None, :2], step[None, :, :2]
    turn = _cross(one, other)
    parallel = turn == 0
    along = _cross(offset, other) / np.where(parallel, 1, turn)
    across = _cross(offset, one) / np.where(parallel, 1, turn)
    meet = ~parallel & (along >= 0) & (along < 1) & (across >= 0) & (across < 1)
    found = []
    for i, j in np.argwhere(np.triu(meet, 2)).tolist():  # neighbours meet in their vertex
        u, v = along[i, j], across[i, j]
        lengths = np.linalg.norm(step[i, :2]) * np.linalg.norm(step[j, :2])
        sine = float(abs(turn[i, j]) / lengths)
        above = start[i, 2] + u * step[i, 2] >= start[j, 2] + v * step[j, 2]
        over, under = (i + u, j + v) if above else (j + v, i + u)
        found.append((float(over), float(under), sine))
    return found


def visible(
    first: float, last: float, hidden: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """What is left of the stretch from `first` to `last` without the hidden ones."""
    left, place = [], first
    for low, high in sorted(hidden):
        if low > place:
            left.append((place, min(low, last)))
        place = max(place, high)
        if place >= last:
            break
    else:
        left.append((place, last))
    return [(low, high) for low, high in left if high > low]


def _at(points: NDArray, places: NDArray) -> NDArray:
    """Points (N, 2) at `places` (N,) along a rope (V, 3), in links from the head."""
    vertices = np.arange(len(points))
    return np.column_stack([np.interp(places, vertices, points[:, axis]) for axis in (0, 1)])


def _cross(a: NDArray, b: NDArray) -> NDArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

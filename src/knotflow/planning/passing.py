"""Whether a strand passed through another one while a rope moved.

In simulation a rope that is pulled hard can slip through itself. Between two frames a crossing of
the projection moves a little along both strands and keeps its order, the one strand above the
other. A crossing that is found again close by, turned the same way round, with its strands in the
other order is a passage: over and under can be exchanged only around an end of the rope, which
takes the crossing away first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.topology.polyline import DegenerateCurveError, planar_crossings

NEAR = 1.5
"""How far a crossing may move along either strand between two frames to be the same, in links."""


@dataclass(frozen=True)
class StrandPassage:
    """A strand that passed through another one.

    Attributes:
        frame: the first one in which the order is another than before.
        places: where on the rope, fractions of its length, the one nearer to the head first.
    """

    frame: int
    places: tuple[float, float]


def find_passages(trajectory: NDArray) -> list[StrandPassage]:
    """Every crossing whose strands exchange their order from one frame to the next.

    Frames whose projection is degenerate are passed over. 50 frames per second are enough for a
    rope dragged at half a metre per second; with fewer, a crossing moves too far to be known again.

    Args:
        trajectory: (T, V, 3) metres.
    """
    found = []
    before: NDArray | None = None
    for frame, points in enumerate(np.asarray(trajectory, np.float64)):
        now = _crossings(points)
        if now is None:
            continue
        if before is not None:
            for place in _exchanged(before, now):
                first, second = (place / (len(points) - 1)).tolist()
                found.append(StrandPassage(frame, (first, second)))
        before = now
    return found


def _crossings(points: NDArray) -> NDArray[np.float64] | None:
    """(c, 4) place on the first and the second strand in links, turn, and height of the first."""
    try:
        met = planar_crossings(points[:, :2])
    except DegenerateCurveError:
        return None
    if met.degenerate:
        return None
    height = [
        points[link, 2] + along * (points[link + 1, 2] - points[link, 2])
        for link, along in ((met.first, met.first_along), (met.second, met.second_along))
    ]
    places = met.first + met.first_along, met.second + met.second_along
    return np.column_stack([*places, met.turn, height[0] - height[1]])


def _exchanged(before: NDArray, now: NDArray) -> NDArray[np.float64]:
    """(n, 2) places of the crossings that are in another order than the nearest one before."""
    if not len(before) or not len(now):
        return np.zeros((0, 2))
    apart = np.abs(before[:, None, :2] - now[None, :, :2]).max(axis=-1)
    apart[before[:, None, 2] != now[None, :, 2]] = np.inf
    # The same crossing: each the other's nearest.
    nearest, back = apart.argmin(axis=0), apart.argmin(axis=1)
    columns = np.arange(len(now))
    same = (back[nearest] == columns) & (apart[nearest, columns] <= NEAR)
    return now[same & (before[nearest, 3] * now[:, 3] < 0), :2]

"""The compiled loop over pairs of links that may lie in each other, with the gradient by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.compiled import LEAST, Vector, compiled, dot, link_at, minus

_APART = 3  # links along the rope from which on two may lie in each other


@compiled
def nearest_places(p: Vector, d: Vector, q: Vector, e: Vector) -> tuple[float, float]:
    """Where a segment from p along d and one from q along e are nearest, shares of d and e.

    Source: Ericson, Real-Time Collision Detection, Sec. 5.1.9.
    """
    r = minus(p, q)
    dd, ee, de = dot(d, d), dot(e, e), dot(d, e)
    dr, er = dot(d, r), dot(e, r)
    s = min(max((de * er - dr * ee) / (dd * ee - de * de + LEAST), 0.0), 1.0)
    t = min(max((de * s + er) / (ee + LEAST), 0.0), 1.0)
    return min(max((de * t - dr) / (dd + LEAST), 0.0), 1.0), t


@compiled
def overlap(
    ropes: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Squared depth (B,) of the strands of ropes (B, V, 3) in each other, in radii, summed over
    pairs of links, and its gradient (B, V, 3).

    Where two links are nearest does not move, to first order, with their ends.
    """
    loss, slope = np.zeros(len(ropes)), np.zeros_like(ropes)
    links = ropes.shape[1] - 1
    length = np.empty(links)
    for rope in range(len(ropes)):
        for place in range(links):
            _, way = link_at(ropes, rope, place)
            length[place] = np.sqrt(dot(way, way))
        for one in range(links - _APART):
            p, d = link_at(ropes, rope, one)
            for other in range(one + _APART, links):
                q, e = link_at(ropes, rope, other)
                begun = minus(p, q)
                if dot(begun, begun) >= (2 * radius + length[one] + length[other]) ** 2:
                    continue
                s, t = nearest_places(p, d, q, e)
                square = 1e-14
                for k in range(3):
                    square += (begun[k] + s * d[k] - t * e[k]) ** 2
                distance = np.sqrt(square)
                depth = 2.0 - distance / radius
                if depth <= 0:
                    continue
                loss[rope] += depth**2
                for k in range(3):
                    gap = begun[k] + s * d[k] - t * e[k]
                    pull = -2.0 * depth / radius * gap / distance
                    slope[rope, one, k] += (1 - s) * pull
                    slope[rope, one + 1, k] += s * pull
                    slope[rope, other, k] -= (1 - t) * pull
                    slope[rope, other + 1, k] -= t * pull
    return loss, slope

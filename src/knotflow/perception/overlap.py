"""The compiled loop over pairs of links that may lie in each other, with the gradient by hand."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_APART = 3  # links along the rope from which on two may lie in each other
_LEAST = 1e-12  # keeps what is divided by from being zero

compiled = njit(cache=True, error_model="numpy")

Vector = tuple[float, float, float]


@compiled
def _dot(one: Vector, other: Vector) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@compiled
def _vertex(ropes: NDArray[np.float64], rope: int, place: int) -> Vector:
    return ropes[rope, place, 0], ropes[rope, place, 1], ropes[rope, place, 2]


@compiled
def _minus(one: Vector, other: Vector) -> Vector:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


@compiled
def nearest_places(p: Vector, d: Vector, q: Vector, e: Vector) -> tuple[float, float]:
    """Where a segment from p along d and one from q along e are nearest, shares of d and e.

    Source: Ericson, Real-Time Collision Detection, Sec. 5.1.9.
    """
    r = _minus(p, q)
    dd, ee, de = _dot(d, d), _dot(e, e), _dot(d, e)
    dr, er = _dot(d, r), _dot(e, r)
    s = min(max((de * er - dr * ee) / (dd * ee - de * de + _LEAST), 0.0), 1.0)
    t = min(max((de * s + er) / (ee + _LEAST), 0.0), 1.0)
    return min(max((de * t - dr) / (dd + _LEAST), 0.0), 1.0), t


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
        for link in range(links):
            way = _minus(_vertex(ropes, rope, link + 1), _vertex(ropes, rope, link))
            length[link] = np.sqrt(_dot(way, way))
        for one in range(links - _APART):
            p = _vertex(ropes, rope, one)
            d = _minus(_vertex(ropes, rope, one + 1), p)
            for other in range(one + _APART, links):
                q = _vertex(ropes, rope, other)
                begun = _minus(p, q)
                if _dot(begun, begun) >= (2 * radius + length[one] + length[other]) ** 2:
                    continue
                e = _minus(_vertex(ropes, rope, other + 1), q)
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

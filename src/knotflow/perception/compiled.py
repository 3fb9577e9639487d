"""What the compiled loops share: how they are compiled, and vectors of three numbers in them.

Loops are compiled when they are first used on a machine, and kept. What is kept of a loop is made
anew when its own file changes, not when this one does: then empty `__pycache__`.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

compiled = njit(cache=True, error_model="numpy")

LEAST = 1e-12
"""Keeps what is divided by from being zero."""

Vector = tuple[float, float, float]


@compiled
def dot(one: Vector, other: Vector) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@compiled
def minus(one: Vector, other: Vector) -> Vector:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


@compiled
def vertex_at(ropes: NDArray[np.float64], rope: int, place: int) -> Vector:
    """One of ropes (B, V, 3)."""
    return ropes[rope, place, 0], ropes[rope, place, 1], ropes[rope, place, 2]


@compiled
def link_at(ropes: NDArray[np.float64], rope: int, place: int) -> tuple[Vector, Vector]:
    """Where a link of ropes (B, V, 3) begins, and how far from there it ends."""
    begin = vertex_at(ropes, rope, place)
    return begin, minus(vertex_at(ropes, rope, place + 1), begin)

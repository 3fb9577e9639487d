"""A rope as a chain of links: equal lengths, nearest places, overlap, registration to points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.rendering import LEAST, Vector, compiled, dot, link_at, minus
from knotflow.simulation import RopeConfig

Floats = NDArray[np.float64]

_APART = 3  # links along the rope from which on two may overlap
_FAR = 0.015  # metres, from where on a point pulls less the farther it is
_LENGTH, _ALIKE, _STAY = 100.0, 20.0, 0.05  # weights beside one of each point
_ROUNDS = 5


def project_lengths(points: NDArray, link_length: float, mobility: NDArray | None = None) -> Floats:
    """The shape with links of equal length nearest to `points` (V, 3), metres, by Newton's method.
    Vertices move in proportion to their `mobility` (V,), positive; by default all alike."""
    shape = np.array(points, np.float64)
    ease = np.ones(len(shape)) if mobility is None else np.asarray(mobility, np.float64)
    for _ in range(50):
        span = np.diff(shape, axis=0)
        length = np.linalg.norm(span, axis=1)
        error = length - link_length
        if np.abs(error).max() < 1e-9 * link_length:
            break
        unit = span / np.maximum(length, 1e-12)[:, None]
        # J J^T, weighted by mobility, is tridiagonal: neighbours share a vertex.
        beside = -ease[1:-1] * (unit[1:] * unit[:-1]).sum(1)
        gram = np.diag(ease[1:] + ease[:-1]) + np.diag(beside, 1) + np.diag(beside, -1)
        pull = np.linalg.solve(gram, error)[:, None] * unit
        shape[:-1] += ease[:-1, None] * pull
        shape[1:] -= ease[1:, None] * pull
    return shape


def nearest_on_chain(points: Floats, chain: Floats) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Where a chain of straight links (V, D) is nearest to points (N, D): the link (N,), the share
    of it that lies before that place (N,), and the way from there to the point (N, D)."""
    links = np.diff(chain, axis=0)
    square = np.maximum((links**2).sum(axis=1), 1e-12)  # seen along itself, a link is a point
    offset = points[:, None] - chain[:-1]  # (N, V - 1, D)
    along = np.clip((offset * links).sum(axis=2) / square, 0.0, 1.0)
    apart = offset - along[..., None] * links
    nearest = (apart**2).sum(axis=2).argmin(axis=1)
    rows = np.arange(len(points))
    return nearest, along[rows, nearest], apart[rows, nearest]


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
def overlap(ropes: Floats, radius: float) -> tuple[Floats, Floats]:
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


def register(start: Floats, cloud: Floats, rope: RopeConfig) -> Floats:
    """The shape (V, 3) near `start` (V, 3) that the rope's points (N, 3) lie on, metres: iterated
    closest points (Besl and McKay, 1992) by Gauss-Newton steps, links of constant length."""
    shape = np.array(start, np.float64)
    if len(cloud) == 0:
        return shape
    count = len(shape)
    second = np.diff(np.eye(count), n=2, axis=0)  # (V - 2, V)
    still = np.kron(_ALIKE * second.T @ second + _STAY * np.eye(count), np.eye(3))
    first = np.diff(np.eye(count), axis=0)  # (V - 1, V)
    for _ in range(_ROUNDS):
        links = np.diff(shape, axis=0)
        length = np.linalg.norm(links, axis=1)
        unit = links / length[:, None]
        stretch = (first[:, :, None] * unit[:, None]).reshape(count - 1, -1)  # (V - 1, 3 V)
        pull, towards = _pull(shape, unit, cloud)
        normal = still + pull + _LENGTH * stretch.T @ stretch
        right = towards + _LENGTH * stretch.T @ (rope.link_length - length)
        shape = shape + np.linalg.solve(normal, right).reshape(count, 3)
    shape = project_lengths(shape, rope.link_length)
    shape[:, 2] = np.maximum(shape[:, 2], rope.radius)
    return shape


def _pull(shape: Floats, unit: Floats, cloud: Floats) -> tuple[Floats, Floats]:
    """Normal equations of the points' pull: (3 V, 3 V) and (3 V,)."""
    count = len(shape)
    nearest, share, off = nearest_on_chain(cloud, shape)
    weight = 1.0 / (1.0 + (off**2).sum(axis=1) / _FAR**2)
    beyond = ((nearest == 0) & (share == 0)) | ((nearest == count - 2) & (share == 1))
    t = np.where(beyond[:, None], 0.0, unit[nearest])
    across = weight[:, None, None] * (np.eye(3) - t[:, :, None] * t[:, None])  # (N, 3, 3)
    towards = (across @ off[:, :, None])[..., 0]  # (N, 3)
    matrix, right = np.zeros((count, count, 3, 3)), np.zeros((count, 3))
    ends = ((nearest, 1 - share), (nearest + 1, share))
    for one, part in ends:
        np.add.at(right, one, part[:, None] * towards)
        for other, rest in ends:
            np.add.at(matrix, (one, other), (part * rest)[:, None, None] * across)
    return matrix.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count), right.ravel()

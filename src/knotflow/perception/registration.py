"""A rope laid onto its points in the image: iterated closest points with a rope's constraints.

Each point of the rope pulls the place on the rope that is nearest to it, but only across the rope:
where along it a point belongs is unknown, except beyond an end. Links keep their lengths and
neighbours move alike (Gauss-Newton on squared errors, Besl and McKay's closest points). It takes
a few milliseconds and reaches farther than gradients in image space do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.fitting import project_lengths
from knotflow.simulation import RopeConfig

Floats = NDArray[np.float64]

_FAR = 0.015  # metres, from where on a point pulls less the farther it is
_LENGTH, _ALIKE, _STAY = 100.0, 20.0, 0.05  # weights beside one of each point
_ROUNDS = 5


def register(start: Floats, cloud: Floats, rope: RopeConfig) -> Floats:
    """The shape (V, 3) near `start` (V, 3) that the rope's points (N, 3) lie on, metres.

    Vertices without points go along with their neighbours.
    """
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

"""By how much the vertices of a fitted rope may be off, by Laplace's approximation.

The fit's loss is taken for the negative logarithm of the shape's probability, and its curvature at
the fitted shape for that of a Gaussian. A vertex is coupled by the loss to three neighbours on
either side, so vertices seven apart are moved at once and 21 pairs of gradients make the whole
Hessian (Curtis, Powell and Reid, On the Estimation of Sparse Jacobian Matrices, 1974); what couples
strands at a crossing is left out. A rope does not stretch: only directions in which its links keep
their lengths count.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.fitting import FitConfig, image_loss, shape_loss
from knotflow.perception.losses import Target
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread

_BAND = 3  # vertices on either side that the loss couples one to
_LARGEST = 0.03  # metres, where neither image nor neighbours hold a vertex


@one_thread()
def spread(
    points: NDArray,
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: FitConfig | None = None,
) -> NDArray[np.float64]:
    """Standard deviation (V,) of the distance of each vertex of a fitted shape (V, 3), metres."""
    config = config or FitConfig()
    count = len(points)
    pixels = target.independent_pixels

    def gradients(shapes: NDArray) -> NDArray[np.float64]:
        moved = torch.tensor(shapes, requires_grad=True)
        loss = image_loss(moved, target, camera, rope, config) + shape_loss(moved, rope, config)
        (slope,) = torch.autograd.grad(pixels * loss.sum(), moved)
        return slope.numpy()

    # Half a pixel: the ends of a rope, which alone keep it from sliding along itself, are seen in
    # whole pixels only.
    size = 0.5 * float(camera.project(points)[:, 2].mean()) / camera.fx
    stride = 2 * _BAND + 1
    hessian = np.zeros((count, 3, count, 3))
    for axis in range(3):
        steps = np.zeros((min(stride, count), count, 3))
        for first, step in enumerate(steps):
            step[first::stride, axis] = size
        columns = (gradients(points + steps) - gradients(points - steps)) / (2 * size)
        for vertex in range(count):
            near = slice(max(0, vertex - _BAND), vertex + _BAND + 1)
            hessian[near, :, vertex, axis] = columns[vertex % stride][near]
    flat = hessian.reshape(3 * count, 3 * count)
    # Between the steps of pixels the loss may curve downwards, though it rises further away.
    free = _keeping_lengths(points)  # (3 V, n)
    values, vectors = np.linalg.eigh(free.T @ (0.5 * (flat + flat.T)) @ free)
    variance = ((free @ vectors) ** 2 / np.maximum(np.abs(values), _LARGEST**-2)).sum(axis=1)
    return np.sqrt(variance.reshape(count, 3).sum(axis=1))


def _keeping_lengths(points: NDArray) -> NDArray[np.float64]:
    """Orthonormal directions (3 V, 2 V + 1) in which a shape (V, 3) keeps its links' lengths."""
    links = len(points) - 1
    unit = np.diff(points, axis=0)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    change = np.zeros((links, links + 1, 3))
    change[range(links), range(links)] = -unit
    change[range(links), range(1, links + 1)] = unit
    *_, directions = np.linalg.svd(change.reshape(links, -1))
    return directions[links:].T

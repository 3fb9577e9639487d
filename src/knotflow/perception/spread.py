"""By how much the vertices of a fitted rope may be off, by Laplace's approximation.

The fit's loss is taken for the negative logarithm of the shape's probability, and its curvature at
the fitted shape for that of a Gaussian. A vertex is coupled by the loss to three neighbours on
either side, so vertices seven apart are moved at once and 21 pairs of gradients make the whole
Hessian (Curtis, Powell and Reid, On the Estimation of Sparse Jacobian Matrices, 1974); what couples
strands at a crossing is left out.
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

CORRELATED = 4.0
"""Neighbouring pixels share their error: so many count as one."""

_BAND = 3  # vertices on either side that the loss couples one to
_STEP = 5e-4  # metres
_LARGEST = 0.05  # metres, where neither image nor neighbours hold a vertex


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
    pixels = float(target.rope.sum()) / CORRELATED

    def gradient(shape: NDArray) -> NDArray[np.float64]:
        moved = torch.tensor(shape, requires_grad=True)
        loss = image_loss(moved, target, camera, rope, config) + shape_loss(moved, rope, config)
        (slope,) = torch.autograd.grad(pixels * loss, moved)
        return slope.numpy()

    stride = 2 * _BAND + 1
    hessian = np.zeros((count, 3, count, 3))
    for first in range(min(stride, count)):
        for axis in range(3):
            step = np.zeros((count, 3))
            step[first::stride, axis] = _STEP
            column = (gradient(points + step) - gradient(points - step)) / (2 * _STEP)
            for vertex in range(first, count, stride):
                near = slice(max(0, vertex - _BAND), vertex + _BAND + 1)
                hessian[near, :, vertex, axis] = column[near]
    flat = hessian.reshape(3 * count, 3 * count)
    values, vectors = np.linalg.eigh(0.5 * (flat + flat.T))
    variance = (vectors**2 / np.maximum(values, _LARGEST**-2)).sum(axis=1)
    return np.sqrt(variance.reshape(count, 3).sum(axis=1))

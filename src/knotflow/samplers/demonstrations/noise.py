"""Noisy copies of a demonstration (Sec. V-B a)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation import clip_splines


@dataclass
class NoiseConfig:
    """Standard deviations of the Gaussian noise that is added to a demonstrated spline."""

    grasp: float = 0.02
    """Of the grasp position, fraction of the rope's length."""
    middle: float = 0.03
    """Of the middle control point's x, y and z, metres."""
    end: float = 0.03
    """Of the end point's x and y, metres."""

    @property
    def scale(self) -> NDArray[np.float64]:
        """(6,) standard deviations in the order of a spline's numbers."""
        return np.array([self.grasp, *[self.middle] * 3, *[self.end] * 2])


def noisy_copies(
    spline: NDArray, count: int, rng: np.random.Generator, config: NoiseConfig
) -> NDArray[np.float64]:
    """(count, 6) splines about a demonstrated one (6,), clipped into range."""
    return clip_splines(spline + rng.normal(size=(count, 6)) * config.scale)

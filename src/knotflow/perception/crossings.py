"""Over and under at the crossings of a tracked rope, gathered from image to image.

A crossing cannot turn over while its strands stay on each other: only an end that passes makes or
unmakes it. So each image adds its evidence to what earlier ones said of the same crossing, and a
shape in which the strands have changed places, because one image was poor, is put right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.certainty import CrossingEvidence, exchange, meetings
from knotflow.perception.fitting import FitConfig, misfit
from knotflow.perception.losses import Target
from knotflow.simulation import RopeConfig

Floats = NDArray[np.float64]

_SAME = 0.12  # of the length, both passages together, by which a crossing moves between images
_FADING = 0.95  # of what earlier images said: their errors are much the same
_MOST, _MOST_EACH = 8.0, 2.0  # log odds that all images, and one of them, can give


@dataclass(frozen=True)
class _Known:
    fractions: tuple[float, float]
    first_over: float  # log odds


class CrossingMemory:
    """What images so far said of each crossing."""

    def __init__(self) -> None:
        self._known: tuple[_Known, ...] = ()

    @classmethod
    def of(cls, crossings: tuple[CrossingEvidence, ...]) -> CrossingMemory:
        """From an estimate's crossings."""
        memory = cls()
        memory._known = tuple(
            _Known(one.fractions, (1 if one.first_over else -1) * _log_odds(one.certainty))
            for one in crossings
        )
        return memory

    @classmethod
    def of_shape(cls, shape: Floats) -> CrossingMemory:
        """From a shape (V, 3) that is known to be right."""
        memory = cls()
        memory._known = tuple(
            _Known(pair, _MOST if _height(shape, pair[0]) > _height(shape, pair[1]) else -_MOST)
            for pair in meetings(shape)
        )
        return memory

    def update(
        self, shape: Floats, target: Target, camera: Camera, rope: RopeConfig, config: FitConfig
    ) -> tuple[Floats, tuple[CrossingEvidence, ...]]:
        """A shape (V, 3) fitted to the next image, its strands as all images together have them.

        Returns:
            The shape, metres, and its crossings in the order met.
        """
        image = target, camera, rope, config
        pairs = meetings(shape)
        loss = misfit(shape, *image) if pairs else 0.0
        known, evidence = [], []
        for pair in pairs:
            over = _height(shape, pair[0]) > _height(shape, pair[1])
            other = exchange(shape, *pair, rope)
            worse = misfit(other, *image) - loss
            favours = float(np.clip(worse, -_MOST_EACH, _MOST_EACH))
            odds = _FADING * self._earlier(pair) + (1 if over else -1) * favours
            odds = float(np.clip(odds, -_MOST, _MOST))
            if odds and (odds > 0) != over:
                shape, loss, over = other, loss + worse, not over
            known.append(_Known(pair, odds))
            gap = abs(_height(shape, pair[0]) - _height(shape, pair[1]))
            evidence.append(CrossingEvidence(pair, bool(over), gap, _probability(abs(odds))))
        self._known = tuple(known)
        return shape, tuple(evidence)

    def _earlier(self, pair: tuple[float, float]) -> float:
        """Log odds, from earlier images, that the first strand of a crossing is on top."""
        if not self._known:
            return 0.0
        apart = [
            abs(one.fractions[0] - pair[0]) + abs(one.fractions[1] - pair[1]) for one in self._known
        ]
        nearest = int(np.argmin(apart))
        return self._known[nearest].first_over if apart[nearest] < _SAME else 0.0


def _height(shape: Floats, fraction: float) -> float:
    return float(np.interp(fraction, np.linspace(0, 1, len(shape)), shape[:, 2]))


def _log_odds(certainty: float) -> float:
    return min(float(np.log(certainty / max(1 - certainty, 1e-9))), _MOST)


def _probability(log_odds: float) -> float:
    return float(1 / (1 + np.exp(-log_odds)))

"""Over and under at the crossings of an estimated rope, and how certain each is.

The log odds are how much worse the shape accounts for the image with the heights of the strands
exchanged, after a few gradient steps. Of a tracked rope they are gathered from image to image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.evidence import Target
from knotflow.perception.estimation.fitting import FitConfig, fit, misfit
from knotflow.simulation import RopeConfig
from knotflow.topology import DegenerateCurveError, project

Floats = NDArray[np.float64]

_EXCHANGED = 5.0  # radii along each strand on either side of a crossing
_STEPS = 25
_SAME = 0.12  # of the length, both passages together, by which a crossing moves between images
_FADING = 0.95  # of what earlier images said: their errors are much the same
_MOST, _MOST_EACH = 8.0, 2.0  # log odds that all images, and one of them, can give


@dataclass(frozen=True)
class CrossingEvidence:
    """A crossing of an estimated rope."""

    fractions: tuple[float, float]
    """Where it is met first and second, 0 at the head and 1 at the tail."""
    first_over: bool
    """Whether the strand nearer to the head is on top."""
    gap: float
    """Distance in height of the strands' axes, metres."""
    certainty: float
    """Probability that it is this way round and not the other, 0.5..1."""

    def reversed(self) -> CrossingEvidence:
        """The same crossing of a rope whose head is the tail."""
        first, second = self.fractions
        return replace(self, fractions=(1 - second, 1 - first), first_over=not self.first_over)


def score_crossings(
    points: NDArray,
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: FitConfig | None = None,
) -> tuple[Floats, tuple[CrossingEvidence, ...]]:
    """A fitted shape (V, 3), metres, each crossing turned the way that the image makes likelier,
    and its crossings in the order met, none where its projection cannot be read."""
    config = config or FitConfig()
    brief = replace(
        config, steps=_STEPS, softness=(config.softness[1],) * 2, step_size=config.step_size / 2
    )
    shape = np.asarray(points, np.float64)
    certainty: dict[int, float] = {}
    loss = misfit(shape, target, camera, rope, config)
    for index in range(len(crossing_fractions(shape))):
        pairs = crossing_fractions(shape)
        if index >= len(pairs):
            break
        other = fit(exchange_heights(shape, *pairs[index], rope), target, camera, rope, brief)
        worse = misfit(other, target, camera, rope, config) - loss
        if worse < 0 and len(crossing_fractions(other)) == len(pairs):
            shape, loss, worse = other, loss + worse, -worse
        certainty[index] = _probability(min(abs(worse), 50.0))
    return shape, tuple(
        _evidence(shape, pair, certainty.get(index, 0.5))
        for index, pair in enumerate(crossing_fractions(shape))
    )


def crossing_fractions(shape: Floats) -> list[tuple[float, float]]:
    """The fractions of the rope's length at which each crossing is met, in the order met."""
    try:
        read = project(shape, min_gap=0.0)
    except DegenerateCurveError:
        return []
    met = (
        (read.fractions[over - 1], read.fractions[under - 1]) for over, under, _ in read.crossings
    )
    return sorted((float(min(pair)), float(max(pair))) for pair in met)


def exchange_heights(shape: Floats, first: float, second: float, rope: RopeConfig) -> Floats:
    """The shape (V, 3) with the heights of its strands exchanged around a crossing."""
    along = np.linspace(0.0, 1.0, len(shape))
    reach = min(_EXCHANGED * rope.radius / rope.length, 0.5 * (second - first))
    exchanged = shape.copy()
    for here, there in ((first, second), (second, first)):
        offset = along - here
        near = np.abs(offset) <= reach
        exchanged[near, 2] = np.interp(there + offset[near], along, shape[:, 2])
    return exchanged


class CrossingMemory:
    """What the images so far said of each crossing: log odds that its first strand is over."""

    def __init__(self) -> None:
        self._odds: dict[tuple[float, float], float] = {}

    @classmethod
    def of(cls, crossings: tuple[CrossingEvidence, ...]) -> CrossingMemory:
        """From an estimate's crossings."""
        memory = cls()
        for one in crossings:
            odds = float(np.log(one.certainty / max(1 - one.certainty, 1e-9)))
            memory._odds[one.fractions] = (1 if one.first_over else -1) * min(odds, _MOST)
        return memory

    @classmethod
    def of_shape(cls, shape: Floats) -> CrossingMemory:
        """From a shape (V, 3) that is known to be right."""
        memory = cls()
        for pair in crossing_fractions(shape):
            memory._odds[pair] = _MOST if _is_first_over(shape, pair) else -_MOST
        return memory

    def update(
        self, shape: Floats, target: Target, camera: Camera, rope: RopeConfig, config: FitConfig
    ) -> tuple[Floats, tuple[CrossingEvidence, ...]]:
        """A shape (V, 3) fitted to the next image, its strands as all the images have them, and
        its crossings in the order met."""
        image = target, camera, rope, config
        pairs = crossing_fractions(shape)
        loss = misfit(shape, *image) if pairs else 0.0
        known: dict[tuple[float, float], float] = {}
        evidence = []
        for pair in pairs:
            first_over = _is_first_over(shape, pair)
            other = exchange_heights(shape, *pair, rope)
            worse = misfit(other, *image) - loss
            favours = float(np.clip(worse, -_MOST_EACH, _MOST_EACH))
            odds = _FADING * self._earlier(pair) + (1 if first_over else -1) * favours
            known[pair] = odds = float(np.clip(odds, -_MOST, _MOST))
            if odds and (odds > 0) != first_over:
                shape, loss, first_over = other, loss + worse, not first_over
            found = _evidence(shape, pair, _probability(abs(odds)))
            evidence.append(replace(found, first_over=first_over))
        self._odds = known
        return shape, tuple(evidence)

    def _earlier(self, pair: tuple[float, float]) -> float:
        """Log odds of a crossing from earlier images."""
        if not self._odds:
            return 0.0
        apart = [abs(one[0] - pair[0]) + abs(one[1] - pair[1]) for one in self._odds]
        nearest = int(np.argmin(apart))
        return list(self._odds.values())[nearest] if apart[nearest] < _SAME else 0.0


def _heights(shape: Floats, pair: tuple[float, float]) -> Floats:
    return np.interp(pair, np.linspace(0, 1, len(shape)), shape[:, 2])


def _is_first_over(shape: Floats, pair: tuple[float, float]) -> bool:
    first, second = _heights(shape, pair)
    return bool(first > second)


def _evidence(shape: Floats, pair: tuple[float, float], certainty: float) -> CrossingEvidence:
    first, second = _heights(shape, pair)
    return CrossingEvidence(pair, bool(first > second), float(abs(first - second)), certainty)


def _probability(log_odds: float) -> float:
    return float(1 / (1 + np.exp(-log_odds)))

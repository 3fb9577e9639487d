"""Over and under at the crossings of an estimated rope, how certain each is, and ends that may or
may not cross a strand.

The log odds of a crossing are how much worse the shape accounts for the image with the heights of
the strands exchanged. Of a tracked rope they are gathered from image to image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.estimation.evidence import Target
from knotflow.perception.estimation.fitting import FitConfig, fit, misfit, nearest_on_chain
from knotflow.simulation import RopeConfig
from knotflow.topology import DegenerateCurveError, project
from knotflow.topology.polyline import Floats

END_AMBIGUITIES = {0: "the head ends at another strand", -1: "the tail ends at another strand"}
"""What is said of an end that may or may not cross a strand."""
_EXCHANGED = 5.0  # radii along each strand on either side of a crossing
_STEPS = 60  # with 25, one rope of 5 to 8 mm in four keeps a wrong crossing; one in 14 with 60
_SAME = 0.12  # of the length, both passages together, by which a crossing moves between images
_SHOWN = 0.99  # certainty that is claimed in words, at most
_FADING = 0.95  # of what earlier images said: their errors are much the same
_MOST, _MOST_EACH = 8.0, 2.0  # log odds that all images, and one of them, can give


@dataclass(frozen=True)
class CrossingEvidence:
    """A crossing of an estimated rope."""

    fractions: tuple[float, float]
    """Where it is met first and second, 0 at the head and 1 at the tail."""
    first_over: bool  # whether the strand nearer to the head is on top
    gap: float  # distance in height of the strands' axes, metres; NaN without depth
    certainty: float  # probability that it is this way round and not the other, 0.5..1

    def reversed(self) -> CrossingEvidence:
        """The same crossing of a rope whose head is the tail."""
        first, second = self.fractions
        return replace(self, fractions=(1 - second, 1 - first), first_over=not self.first_over)

    def describe(self) -> str:
        """Where it is, which strand is on top, and how certain that is, for printing."""
        first, second = self.fractions
        apart = "" if math.isnan(self.gap) else f"axes {1e3 * self.gap:.0f} mm apart, "
        return (
            f"{first:.0%} of the rope from its head lies {'over' if self.first_over else 'under'} "
            f"{second:.0%}, {apart}{min(self.certainty, _SHOWN):.0%} certain"
        )


def ambiguous_ends(shape: NDArray, rope: RopeConfig) -> tuple[int, ...]:
    """The ends, 0 for the head and -1 for the tail, of a shape (V, 3) that may or may not cross a
    strand: those within a radius of another strand's centre line, seen from above."""
    own = math.ceil(math.pi / rope.max_bend)  # links of the tightest half turn
    ends = []
    for end, from_end in ((0, shape[:, :2]), (-1, shape[::-1, :2])):
        others = from_end[own:]
        if len(others) > 1:
            *_, off = nearest_on_chain(from_end[:1], others)
            if np.linalg.norm(off) < rope.radius:
                ends.append(end)
    return tuple(ends)


def score_crossings(
    points: NDArray, target: Target, config: FitConfig | None = None
) -> tuple[Floats, tuple[CrossingEvidence, ...]]:
    """A fitted shape (V, 3), metres, each crossing turned the way that the image makes likelier,
    and its crossings in the order met, none where its projection cannot be read."""
    config = config or FitConfig()
    brief = replace(
        config, steps=_STEPS, softness=(config.softness[1],) * 2, step_size=config.step_size / 2
    )
    shape = np.asarray(points, np.float64)
    certainty: dict[int, float] = {}
    loss = misfit(shape, target, config)
    for index in range(len(crossing_fractions(shape))):
        pairs = crossing_fractions(shape)
        if index >= len(pairs):
            break
        other = fit(exchange_heights(shape, *pairs[index], target.rope), target, brief)
        worse = misfit(other, target, config) - loss
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
            memory._odds[pair] = _MOST if _evidence(shape, pair, 1.0).first_over else -_MOST
        return memory

    def update(
        self, shape: Floats, target: Target, config: FitConfig
    ) -> tuple[Floats, tuple[CrossingEvidence, ...]]:
        """A shape (V, 3) fitted to the next image, its strands as all the images have them, and
        its crossings in the order met."""
        pairs = crossing_fractions(shape)
        loss = misfit(shape, target, config) if pairs else 0.0
        known: dict[tuple[float, float], float] = {}
        evidence = []
        for pair in pairs:
            first_over = _evidence(shape, pair, 1.0).first_over
            other = exchange_heights(shape, *pair, target.rope)
            worse = misfit(other, target, config) - loss
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


def _evidence(shape: Floats, pair: tuple[float, float], certainty: float) -> CrossingEvidence:
    first, second = np.interp(pair, np.linspace(0, 1, len(shape)), shape[:, 2])
    return CrossingEvidence(pair, bool(first > second), float(abs(first - second)), certainty)


def _probability(log_odds: float) -> float:
    return float(1 / (1 + np.exp(-log_odds)))

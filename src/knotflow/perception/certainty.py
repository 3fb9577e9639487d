"""How sure the crossings of an estimated rope are: could each be the other way round?

The image of a crossing shows the upper strand, and the lower one only beside it. The other way
round, the same two strands lie with their heights exchanged, and would look different in depth.
A few gradient steps let that shape account for the image as well as it can; how much worse it
does is the logarithm of how much less likely it is, as the losses in image space are squared
errors in units of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.fitting import FitConfig, fit, misfit
from knotflow.perception.losses import Target
from knotflow.simulation import RopeConfig
from knotflow.topology import DegenerateCurveError, project

Floats = NDArray[np.float64]

_EXCHANGED = 5.0  # radii along each strand on either side of a crossing
_STEPS = 25


@dataclass(frozen=True)
class CrossingEvidence:
    """A crossing of an estimated rope.

    Attributes:
        fractions: where it is met first and second, 0 at the head and 1 at the tail.
        first_over: whether the strand nearer to the head is on top.
        gap: distance in height of the strands' axes, metres.
        certainty: probability that it is this way round and not the other, 0.5..1.
    """

    fractions: tuple[float, float]
    first_over: bool
    gap: float
    certainty: float

    def turned(self) -> CrossingEvidence:
        """The same crossing of a rope whose head is the tail."""
        first, second = self.fractions
        return replace(self, fractions=(1 - second, 1 - first), first_over=not self.first_over)


def weigh_crossings(
    points: NDArray,
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: FitConfig | None = None,
) -> tuple[Floats, tuple[CrossingEvidence, ...]]:
    """Turns the crossings of a fitted shape (V, 3) the way that the image makes likelier.

    Returns:
        The shape (V, 3), metres, and its crossings with their certainty, in the order met. None
        where the shape's projection cannot be read.
    """
    config = config or FitConfig()
    brief = replace(
        config, steps=_STEPS, softness=(config.softness[1],) * 2, step_size=config.step_size / 2
    )
    shape = np.asarray(points, np.float64)
    weighed: dict[int, float] = {}
    loss = misfit(shape, target, camera, rope, config)
    for index in range(len(meetings(shape))):
        pairs = meetings(shape)
        if index >= len(pairs):
            break
        other = fit(exchange(shape, *pairs[index], rope), target, camera, rope, brief)
        worse = misfit(other, target, camera, rope, config) - loss
        if worse < 0 and len(meetings(other)) == len(pairs):
            shape, loss, worse = other, loss + worse, -worse
        weighed[index] = float(1 / (1 + np.exp(-min(abs(worse), 50.0))))
    evidence = []
    for index, (first, second) in enumerate(meetings(shape)):
        heights = np.interp([first, second], np.linspace(0, 1, len(shape)), shape[:, 2])
        evidence.append(
            CrossingEvidence(
                (first, second),
                bool(heights[0] > heights[1]),
                float(abs(heights[0] - heights[1])),
                weighed.get(index, 0.5),
            )
        )
    return shape, tuple(evidence)


def meetings(shape: Floats) -> list[tuple[float, float]]:
    """The fractions of the rope's length at which each crossing is met, in the order met."""
    try:
        read = project(shape, min_gap=0.0)
    except DegenerateCurveError:
        return []
    met = (
        (read.fractions[over - 1], read.fractions[under - 1]) for over, under, _ in read.crossings
    )
    return sorted((float(min(pair)), float(max(pair))) for pair in met)


def exchange(shape: Floats, first: float, second: float, rope: RopeConfig) -> Floats:
    """The shape (V, 3) with the heights of its strands exchanged around a crossing."""
    along = np.linspace(0.0, 1.0, len(shape))
    reach = min(_EXCHANGED * rope.radius / rope.length, 0.5 * (second - first))
    exchanged = shape.copy()
    for here, there in ((first, second), (second, first)):
        offset = along - here
        near = np.abs(offset) <= reach
        exchanged[near, 2] = np.interp(there + offset[near], along, shape[:, 2])
    return exchanged

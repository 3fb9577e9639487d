"""A rope shape's crossings together with the topological state that they make (Sec. IV)."""

from __future__ import annotations

from functools import cached_property

from numpy.typing import ArrayLike

from knotflow.topology.polyline import DegenerateCurveError, Floats
from knotflow.topology.projection import DEFAULT_MIN_GAP, Projection, read_crossings
from knotflow.topology.state import TopologicalState

__all__ = [
    "DEFAULT_MIN_GAP",
    "CurveCrossings",
    "DegenerateCurveError",
    "project",
    "segment_intervals",
    "segment_lengths",
]


class CurveCrossings(Projection):
    """The crossings of a projected rope, and its state."""

    @cached_property
    def state(self) -> TopologicalState:
        """The topological state."""
        return TopologicalState.from_crossings(self.crossings)


def project(points: ArrayLike, min_gap: float = DEFAULT_MIN_GAP) -> CurveCrossings:
    """Read the crossings and the state of a rope off its shape.

    Args:
        points: (V, 3) metres, head first, world frame, z up; V at least 2.
        min_gap: metres; strands of a crossing that are closer in z are refused.

    Raises:
        DegenerateCurveError: the projection does not determine the state; says where on the rope.
        ValueError: not finite (V, 3) numbers.
    """
    read = read_crossings(points, min_gap)
    return CurveCrossings(read.crossings, read.fractions, read.xy, read.heights)


def segment_intervals(points: ArrayLike, min_gap: float = DEFAULT_MIN_GAP) -> Floats:
    """Where each segment of a rope shape begins and ends: (num_segments, 2) length fractions.

    Arguments and errors are those of `project`.
    """
    return project(points, min_gap).segment_intervals


def segment_lengths(points: ArrayLike, min_gap: float = DEFAULT_MIN_GAP) -> Floats:
    """How long each segment of a rope shape is: (num_segments,) length fractions.

    Arguments and errors are those of `project`.
    """
    return project(points, min_gap).segment_lengths

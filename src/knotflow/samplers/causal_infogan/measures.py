"""What is measured of a plan of rope shapes (Sec. VII-C, Fig. 8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation import state_or_none


@dataclass(frozen=True)
class PlanMeasures:
    """One plan against the shapes it was asked to join."""

    start_distance: float
    """From the given start to its projection, mean over vertices, metres."""
    end_distance: float
    """From the given end to its projection, mean over vertices, metres."""
    start_kept: bool
    """Whether the projected start has the given start's topological state."""
    end_kept: bool
    """Whether the projected end has the given end's topological state."""
    unevenness: float
    """Standard deviation over mean of the steps from the projected start over all way points to
    the projected end, each the mean motion of a vertex; 0 where progress is even."""
    largest_stretch: float
    """Largest change of a link's length in any of these shapes, over its length when given."""


def measure(
    start: NDArray,
    projected_start: NDArray,
    way_points: NDArray,
    projected_end: NDArray,
    end: NDArray,
) -> PlanMeasures:
    """Measures of a plan: way points (steps + 1, V, 3), the other shapes (V, 3), metres."""
    shapes = np.concatenate([projected_start[None], way_points, projected_end[None]])
    steps = np.linalg.norm(np.diff(shapes, axis=0), axis=-1).mean(axis=-1)
    rest = np.linalg.norm(np.diff(start, axis=0), axis=-1)
    lengths = np.linalg.norm(np.diff(shapes, axis=1), axis=-1)
    return PlanMeasures(
        start_distance=float(np.linalg.norm(projected_start - start, axis=-1).mean()),
        end_distance=float(np.linalg.norm(projected_end - end, axis=-1).mean()),
        start_kept=_same_state(projected_start, start),
        end_kept=_same_state(projected_end, end),
        unevenness=float(steps.std() / steps.mean()) if steps.any() else 0.0,
        largest_stretch=float(np.abs(lengths / rest - 1).max()),
    )


def _same_state(projected: NDArray, given: NDArray) -> bool:
    state = state_or_none(projected)
    return state is not None and state == state_or_none(given)

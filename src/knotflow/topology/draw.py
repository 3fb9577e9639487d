"""From a topological state to a rope shape that has it: a rounded knot diagram with heights."""

from __future__ import annotations

import numpy as np

from knotflow.topology.curve import project
from knotflow.topology.embedding import build_mesh, tutte
from knotflow.topology.polyline import DegenerateCurveError, Floats, planar_crossings
from knotflow.topology.relaxation import relax
from knotflow.topology.state import TopologicalState

ROPE_LENGTH = 1.0
"""Metres, in the projection."""

ROPE_GAP = 0.016
"""Metres. Height of an over strand above an under strand, one diameter of the default rope."""


def draw(
    state: TopologicalState,
    length: float = ROPE_LENGTH,
    gap: float = ROPE_GAP,
    samples: int = 8,
) -> Floats:
    """A rounded rope shape with the given state.

    Args:
        state: any state.
        length: metres, of the rope in the projection.
        gap: metres, height of the over strand at each crossing; under strands and both ends
            are at z = 0.
        samples: points for each of the 4 pieces of a segment.

    Returns:
        (V, 3) metres, head first, centred at the origin, V = 4 * samples * (2c + 1) + 1. The points
        are closer together where the drawing is dense; `TopologicalState.from_curve` gives the
        state back. The same state always gives the same shape.

    Raises:
        ValueError: length or gap is not above 0, or there is no sample.
        RuntimeError: the drawing does not read back as the state: `samples` is too small, or the
            crossings are very many (no failure is known with up to 12).
    """
    if not (length > 0.0 and gap > 0.0 and samples >= 1):
        raise ValueError(
            f"length and gap must be above 0 and samples at least 1, got {length}, {gap}, {samples}"
        )
    mesh = build_mesh(state)
    nodes = relax(mesh, tutte(mesh))[mesh.path]
    xy = _spline(nodes, samples)
    xy *= length / np.linalg.norm(np.diff(xy, axis=0), axis=1).sum()
    points = _lift(state, xy - (xy.min(axis=0) + xy.max(axis=0)) / 2.0, gap)
    try:
        drawn = project(points, min_gap=gap / 2.0).state
    except DegenerateCurveError as error:
        raise RuntimeError(f"the drawing of {state} is degenerate: {error}") from error
    if drawn != state:
        raise RuntimeError(f"the drawing of {state} reads back as {drawn}")
    return points


def _spline(nodes: Floats, samples: int) -> Floats:
    """The uniform cubic B-spline with these control points, from the first to the last."""
    # Mirrored end nodes make it begin and end there.
    before, after = 2.0 * nodes[:1] - nodes[1:2], 2.0 * nodes[-1:] - nodes[-2:-1]
    control = np.concatenate((before, nodes, after))
    u = (np.arange(samples) / samples)[:, None]
    basis = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    pieces = len(nodes) - 1
    curve = sum(b * control[k : k + pieces, None] / 6.0 for k, b in enumerate(basis))
    return np.concatenate((np.reshape(curve, (-1, 2)), nodes[-1:]))


def _lift(state: TopologicalState, xy: Floats, gap: float) -> Floats:
    """Give a flat drawing its heights, smoothly from one passage of a crossing to the next."""
    passed = np.sort(planar_crossings(xy).passed)
    reached = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))))
    over = {position for position, _, _ in state.crossings}
    wanted = [gap if position in over else 0.0 for position in range(1, state.num_segments)]
    if len(passed) != len(wanted):
        raise RuntimeError(
            f"the drawing of {state} has {len(passed) // 2} crossings; more samples may help"
        )
    knots = np.concatenate(([0.0], passed, [reached[-1]]))
    heights = np.array([0.0, *wanted, 0.0])
    span = np.clip(np.searchsorted(knots, reached, side="right") - 1, 0, len(knots) - 2)
    u = (reached - knots[span]) / (knots[span + 1] - knots[span])
    z = heights[span] + (heights[span + 1] - heights[span]) * (3.0 - 2.0 * u) * u**2
    return np.column_stack((xy, z))

"""A rope drawn with the mouse: a polyline on the table becomes a rope at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.planning import RopeInputError, lay_down
from knotflow.simulation import SPLINE_HIGH, RopeConfig, resample
from knotflow.topology import TopologicalState

_SLOPE = 0.1
"""Rise per length, in which a later strand is over an earlier one, as one lays a rope."""
_ROUNDS = 4  # of corner cutting: bends of a polyline become those of a rope


def lay_drawn(clicked: ArrayLike, rope: RopeConfig) -> NDArray[np.float64]:
    """A rope (V, 3) along a polyline (N, 2) on the table, metres, head first.

    Its corners are rounded, it is scaled to the rope's length, and its middle put at the origin.
    Where it crosses itself what was drawn later is on top.

    Raises:
        RopeInputError: fewer than two points; a drawing too small, too sharp or too dense for a
            rope of this thickness; says which.
    """
    corners = np.asarray(clicked, np.float64).reshape(-1, 2)
    if len(corners) < 2:
        raise RopeInputError("a drawn rope needs at least two points: click on the table")
    for _ in range(_ROUNDS):  # Chaikin
        ahead, behind = corners[:-1], corners[1:]
        cut = np.stack([0.75 * ahead + 0.25 * behind, 0.25 * ahead + 0.75 * behind], axis=1)
        corners = np.concatenate([corners[:1], cut.reshape(-1, 2), corners[-1:]])
    steps = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    drawn = float(steps.sum())
    if drawn < 0.2 * rope.length:
        raise RopeInputError(f"the drawing is {drawn:.2f} m long, the rope {rope.length:g} m")
    heights = _SLOPE * np.r_[0.0, np.cumsum(steps)]
    curve = np.column_stack([corners, heights]) * rope.length / drawn
    flat = (curve[:, :2].min(axis=0) + curve[:, :2].max(axis=0)) / 2
    curve[:, :2] -= flat
    points = lay_down(resample(curve, rope), rope)
    if np.abs(points[:, :2]).max() > SPLINE_HIGH[-1]:
        raise RopeInputError(f"stretched to {rope.length:g} m it would leave the gripper's reach")
    links = np.diff(points, axis=0) / rope.link_length
    bend = np.arccos(np.clip((links[1:] * links[:-1]).sum(axis=1), -1.0, 1.0)).max()
    if bend > rope.max_bend:
        raise RopeInputError(
            f"it bends by {np.degrees(bend):.0f} degrees within a link, the rope by "
            f"{np.degrees(rope.max_bend):.0f} at most: draw wider turns"
        )
    if TopologicalState.from_curve(points) != TopologicalState.from_curve(curve):
        raise RopeInputError("its crossings are too close together for this rope: draw it wider")
    return points

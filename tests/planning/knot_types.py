"""The knot type of a tied rope, by an independent library (topoly)."""

import os

import numpy as np
import pytest

from knotflow.topology.draw import draw

MAX_CROSSINGS = 40
"""Of the projected curve; with topoly's own limit of 15 a pentagram at rest has no type."""


def closed_curve(points):
    """The rope (V, 3) with its ends joined above everything: (V + 3, 3), the last point the first.

    Seen from above the joining arc passes over everything, so its course does not matter. If both
    ends border one face of the projection, as in every state of a prime knot, it can be slid into
    that face, and the closure is the diagram that the state was cut from (`topology.knots`).
    Otherwise joining above everything is the convention.
    """
    rope = np.asarray(points, np.float64)
    above = rope[[-1, 0]]
    above[:, 2] = rope[:, 2].max() + np.ptp(rope, axis=0).max()
    return np.concatenate((rope, above, rope[:1]))


def knot_type(points):
    """The knot type of a rope (V, 3) from the HOMFLY-PT polynomial of its closure.

    In Rolfsen's table, with its chirality where it has one: "0_1", "+3_1" (right-handed overhand),
    "-3_1", "4_1" (figure eight), "+5_1" (pentagram), ...
    """
    topoly = pytest.importorskip("topoly")
    kept = os.dup(0)  # topoly closes it
    try:
        return str(
            topoly.homfly(
                closed_curve(points).tolist(),
                closure=topoly.Closure.CLOSED,
                chiral=True,
                max_cross=MAX_CROSSINGS,
                run_parallel=False,  # else it forks a pool even for one curve
            )
        )
    finally:
        os.dup2(kept, 0)
        os.close(kept)


def expected_type(state):
    """The knot type that a state has: that of a drawing of it."""
    return knot_type(draw(state))

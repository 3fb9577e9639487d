"""The knot type of a tied rope, reported by an independent library (topoly).

An open rope has a knot type only once its ends are joined. Here each end goes straight up and the
two are joined high above everything. Seen from above the joining arc passes over whatever lies
between the ends, and an arc that is on top can be slid about freely, so its course does not
matter. When both ends border one face of the projection, as they do in every state of a named
knot, it can be slid into that face without crossing anything: the closure is the closed diagram
that the state was cut from (`topology.knots`), and its type the named knot's. When an end lies
inside the tangle, where no joining within the plane is free of crossings, the closure above
everything is the convention.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.planning.homfly import homfly_type
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw


class KnotMismatchError(ValueError):
    """A rope that is not tied into the knot that its goal state is."""


def closed_curve(points: ArrayLike) -> NDArray[np.float64]:
    """The rope (V, 3) with its ends joined above everything: (V + 3, 3), the last point the first.

    The joining height is one extent of the rope above its top, in metres.
    """
    rope = np.asarray(points, np.float64)
    top = rope[:, 2].max() + np.ptp(rope, axis=0).max()
    above = rope[[-1, 0]]
    above[:, 2] = top
    return np.concatenate((rope, above, rope[:1]))


def knot_type(points: ArrayLike) -> str:
    """The knot type of a rope shape from the HOMFLY-PT polynomial of its closure.

    Args:
        points: (V, 3) metres, head first.

    Returns:
        The name in Rolfsen's table with its chirality where it has one: "0_1" (unknotted),
        "+3_1" (right-handed overhand), "-3_1", "4_1" (figure eight), "+5_1" (pentagram), ...

    Raises:
        ModuleNotFoundError: topoly, of the extra `test`, is not installed.
        RuntimeError: topoly failed; says how.
    """
    return homfly_type(closed_curve(points).tolist())


def expected_type(state: TopologicalState) -> str:
    """The knot type that a state has: that of a drawing of it. Raises as `knot_type`."""
    return knot_type(draw(state))


def confirm(points: ArrayLike, goal: TopologicalState | None = None) -> str:
    """The knot type of a tied rope, e.g. "+3_1"; see `knot_type`.

    Args:
        points: (V, 3) the rope at rest, metres, head first.
        goal: the state it should be in; its knot type is compared if given.

    Raises:
        KnotMismatchError: the rope's type is not that of `goal`.
        ModuleNotFoundError: topoly is not installed.
    """
    found = knot_type(points)
    if goal is not None and found != (expected := expected_type(goal)):
        raise KnotMismatchError(
            f"the rope is a {found}, but a rope in the state {goal} is a {expected}"
        )
    return found

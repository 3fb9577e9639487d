"""Which parts of a rope an action is about: streams, origin and grasp (Sec. V-A, Fig. 4).

`encoding` says what they are for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.primitives.canonical import UNDO, Canonical
from knotflow.topology import R1, R2, Cross, Undo

GRASP_SCALE = 0.3
"""Share of the over segment a unit of the grasp; its middle is 0. Of the whole rope where any part
of it may be grasped: arranging and undoing."""
TIP_GRASP, TIP_GRASP_SCALE = 0.04, 0.04
"""Where the over segment is the rope's head (primitive 3) the grasp counts from its tip: shares of
the rope's length that are 0 and a unit."""

_AXIS = 0.05  # of the rope's length to each side: the x axis should not follow every ripple
_WIDE_AXIS = 0.15  # of the segment's length, where a segment is laid over itself


def streams_of(rope: Canonical) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the first two streams begin and end, (2,) fractions of the rope's length.

    The over and the under stream; of an undoing, the piece that is pulled and the strand it leaves.
    """
    action, segments = rope.action, rope.segments
    if isinstance(action, Undo):
        pulled, other = (
            choose(len(segments)) for choose in (action.pulled_segment, action.other_segment)
        )
        # Canonical: Cross is of the head, so its strand goes on behind the crossing.
        last = other if isinstance(action.action, Cross) else other + 1
        return segments[pulled], np.array([segments[other - 1, 0], segments[last, 1]])
    over, under = segments[action.over_segment], segments[action.under_segment]
    if isinstance(action, R2) and action.over == action.under:
        middle = over.mean()
        # Canonical: the half nearer to the head is over.
        over, under = np.array([over[0], middle]), np.array([middle, over[1]])
    return over, under


def marks_of(rope: Canonical) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the over and the under strand begin and end, (2,) fractions of the rope's length.

    They are the first and the second stream, unless an undoing pulls a piece from under a strand.
    """
    first, second = streams_of(rope)
    action = rope.action
    pulls_under = isinstance(action, Undo) and (
        action.pulled_segment(len(rope.segments)) != action.over_segment
    )
    return (second, first) if pulls_under else (first, second)


def anchor_of(rope: Canonical) -> tuple[float, float]:
    """Where on the rope the frame's origin is, and how far to each side its direction is taken."""
    if isinstance(rope.action, Undo):
        begin, end = rope.segments[rope.action.other_segment(len(rope.segments))]
        # Canonical: R1's first passage is under, and Cross is of the head.
        return ((begin + end) / 2 if isinstance(rope.action.action, R2) else begin), _AXIS
    begin, end = rope.segments[rope.action.under_segment]
    if rope.action.over_segment == rope.action.under_segment:
        # Canonical: R1's first passage is under, and of an R2(i,i) the half nearer to the tail.
        third = 1 / 6 if isinstance(rope.action, R1) else 5 / 6
        return begin + third * (end - begin), _WIDE_AXIS * (end - begin)
    return (begin if rope.primitive == 4 else (begin + end) / 2), _AXIS


def grasp_of(rope: Canonical, arranging: bool) -> NDArray[np.float64]:
    """(2,) the grasp that is 0 in network space, and a unit of it, fractions of the length."""
    if arranging:
        return np.array([0.5, GRASP_SCALE])
    if rope.primitive == 3:
        return np.array([TIP_GRASP, TIP_GRASP_SCALE])
    grasped, _ = streams_of(rope)
    if rope.primitive == UNDO:
        # Counted in pieces, most drags that undo would be tens of units away: an end beyond its
        # crossing is a twentieth of the rope, and it is pulled back from behind the crossing.
        return np.array([grasped[1] if grasped[0] == 0 else grasped.mean(), GRASP_SCALE])
    return np.array([grasped.mean(), GRASP_SCALE * (grasped[1] - grasped[0])])

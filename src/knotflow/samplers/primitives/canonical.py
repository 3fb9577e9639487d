"""Canonical actions, by Mirror and Reverse, and the parts of the rope that they are about.

The two transformations and their combination make groups of four actions (Sec. V-A, Fig. 3). Of
each group one action is learned, the canonical one:

| primitive             | canonical action                                                |
|-----------------------|-----------------------------------------------------------------|
| 1: R1                 | left = +1, sign = +1                                            |
| 2: R2                 | left = +1; the over strand is the one nearer to the head        |
| 3: Cross, end over    | sign = +1; the over segment is the head                         |
| 4: the other Cross    | sign = +1; the under segment is the head                        |
| 5: arranging          | that of the action which is wanted next                         |
| 6: undoing            | the action that is taken back is canonical                      |

No action is its own counterpart, so a rope and action give bit for bit the same canonical rope as
their mirrored or reversed selves, which makes the symmetry of proposals exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from knotflow.simulation import NOMINAL, RopeConfig
from knotflow.topology import R1, R2, Action, Cross, IllegalActionError, Undo, segment_intervals
from knotflow.topology.polyline import Floats
from knotflow.topology.symmetry import Symmetry

PRIMITIVES = (1, 2, 3, 4)
"""The sets of actions of Sec. V-A, each with networks of its own."""
ARRANGE, UNDO = 5, 6
"""The primitives beyond the paper: of splines that keep the state and make room for the action
wanted next, and of all undoings."""
ALL_PRIMITIVES = (*PRIMITIVES, ARRANGE, UNDO)

GRASP_SCALE = 0.3
"""Share of the over segment a unit of the grasp; its middle is 0. Of the whole rope where any part
of it may be grasped: arranging and undoing."""
TIP_GRASP, TIP_GRASP_SCALE = 0.04, 0.04
"""Where the over segment is the rope's head (primitive 3) the grasp counts from its tip: shares of
the rope's length that are 0 and a unit."""

_AXIS = 0.05  # of the rope's length to each side: the x axis should not follow every ripple
_WIDE_AXIS = 0.15  # of the segment's length, where a segment is laid over itself


def primitive_of(action: Action, num_segments: int) -> int:
    """The primitive, 1 to 4 or `UNDO`, for an action on a rope with so many segments."""
    if isinstance(action, R1):
        return 1
    if isinstance(action, R2):
        return 2
    if isinstance(action, Cross):
        return 3 if action.over in (0, num_segments - 1) else 4
    if isinstance(action, Undo):
        return UNDO
    raise IllegalActionError(f"no primitive instantiates {action}; they know R1, R2, Cross, Undo")


def kinds_of(action: Action, num_segments: int) -> tuple[int, ...]:
    """The primitive of an action, and of an undoing also that of the action it takes back."""
    if isinstance(action, Undo):
        before = action.num_segments_after(num_segments)
        return (UNDO, primitive_of(action.action, before))
    return (primitive_of(action, num_segments),)


def is_canonical(action: Action, num_segments: int) -> bool:
    """Whether an action is the one of its group that is learned."""
    if isinstance(action, R1):
        return action.left == 1 and action.sign == 1
    if isinstance(action, R2):
        return action.left == 1 and action.is_over_first
    if isinstance(action, Undo):
        return is_canonical(action.action, action.num_segments_after(num_segments))
    primitive = primitive_of(action, num_segments)
    assert isinstance(action, Cross)
    return action.sign == 1 and (action.over if primitive == 3 else action.under) == 0


@lru_cache(maxsize=4096)
def canonical_symmetry(action: Action, num_segments: int) -> Symmetry:
    """The one transformation that makes an action canonical; see `canonicalise`."""
    action.check_segments(num_segments)
    for symmetry in Symmetry.all():
        if is_canonical(symmetry.of_action(action, num_segments), num_segments):
            return symmetry
    raise IllegalActionError(f"{action} has no learned counterpart: no end of the rope is in it")


@dataclass(frozen=True)
class Canonical:
    """A rope and an action brought to the learned counterpart by `symmetry`."""

    points: Floats  # (V, 3) the transformed rope, metres, its own head first
    action: Action  # the canonical one
    segments: Floats  # (num_segments, 2) where each begins and ends, fractions of the length
    symmetry: Symmetry  # the transformation that led here, its own inverse
    rope: RopeConfig

    @property
    def primitive(self) -> int:
        return primitive_of(self.action, len(self.segments))


def canonicalise(points: Floats, action: Action, rope: RopeConfig | None = None) -> Canonical:
    """Mirror and reverse a shape (V, 3) so that the action becomes canonical; of the nominal rope
    unless another is given.

    Raises:
        IllegalActionError: the action names a segment that the rope does not have.
        DegenerateCurveError: the segments of the rope cannot be read.
    """
    points = np.asarray(points, dtype=np.float64)
    segments = _segments(points.tobytes())
    symmetry = canonical_symmetry(action, len(segments))
    if symmetry.mirror or symmetry.reverse:
        points = symmetry.of_points(points)
        # Read again, not transformed: rounding would break the exact symmetry.
        segments = _segments(points.tobytes())
    action = symmetry.of_action(action, len(segments))
    return Canonical(np.ascontiguousarray(points), action, segments, symmetry, rope or NOMINAL)


@lru_cache(maxsize=64)
def _segments(points: bytes) -> Floats:
    """`segment_intervals`, read once of a rope that is asked for with every action it allows."""
    segments = segment_intervals(np.frombuffer(points).reshape(-1, 3))
    segments.flags.writeable = False
    return segments


def streams_of(rope: Canonical) -> tuple[Floats, Floats]:
    """Where the first two streams begin and end, (2,) fractions of the rope's length.

    The over and the under stream; of an undoing, the piece that is pulled and the strand it leaves.
    """
    action, segments = rope.action, rope.segments
    if isinstance(action, Undo):
        pulled = action.pulled_segment(len(segments))
        other = action.other_segment(len(segments))
        # Canonical: Cross is of the head, so its strand goes on behind the crossing.
        last = other if isinstance(action.action, Cross) else other + 1
        return segments[pulled], np.array([segments[other - 1, 0], segments[last, 1]])
    over, under = segments[action.over_segment], segments[action.under_segment]
    if isinstance(action, R2) and action.over == action.under:
        middle = over.mean()
        # Canonical: the half nearer to the head is over.
        over, under = np.array([over[0], middle]), np.array([middle, over[1]])
    return over, under


def marks_of(rope: Canonical) -> tuple[Floats, Floats]:
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


def grasp_of(rope: Canonical, arranging: bool) -> Floats:
    """(2,) the grasp that is 0 in network space, and a unit of it, fractions of the length."""
    if arranging:
        return np.array([0.5, GRASP_SCALE])
    if rope.primitive == 3:
        return np.array([TIP_GRASP, TIP_GRASP_SCALE])
    grasped, _ = streams_of(rope)
    if rope.primitive == UNDO:
        # In units of the whole rope: an end beyond its crossing is short, and is pulled back from
        # behind the crossing.
        return np.array([grasped[1] if grasped[0] == 0 else grasped.mean(), GRASP_SCALE])
    return np.array([grasped.mean(), GRASP_SCALE * (grasped[1] - grasped[0])])

"""Mirror and Reverse bring every action to its learned counterpart (Sec. V-A, Fig. 3).

The two transformations and their combination make groups of four actions. Of each group one action
is learned, the canonical one:

| primitive             | canonical action                                                |
|-----------------------|-----------------------------------------------------------------|
| 1: R1                 | left = +1, sign = +1                                            |
| 2: R2                 | left = +1; the over strand is the one nearer to the head        |
| 3: Cross, end over    | sign = +1; the over segment is the head                         |
| 4: the other Cross    | sign = +1; the under segment is the head                        |
| 5: arranging          | that of the action which is wanted next                         |
| 6: undoing            | the action that is taken back is canonical                      |

No action is its own counterpart, so the choice is unique, and a rope and action give bit for bit
the same canonical rope as their mirrored or reversed selves. Everything after this point
(encoding, networks, random numbers) happens there, which makes the symmetry of proposals exact.
Arranging, which keeps the state and makes room for an action, is no topological action: it knows
ropes and actions by the same counterparts as the primitive of the action that is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from knotflow.topology import R1, R2, Action, Cross, IllegalActionError, Undo, segment_intervals
from knotflow.topology.symmetry import Symmetry

PRIMITIVES = (1, 2, 3, 4)
"""The sets of actions of Sec. V-A, each with networks of its own."""
ARRANGE = 5
"""The primitive of splines that keep the state and make room for the action wanted next."""
UNDO = 6
"""The primitive of all undoings."""
ALL_PRIMITIVES = (*PRIMITIVES, ARRANGE, UNDO)
"""Those of the paper, and those beyond it."""


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
    """The one transformation that makes an action canonical.

    Raises:
        IllegalActionError: the action names a segment beyond the last.
    """
    action.check_segments(num_segments)
    for symmetry in Symmetry.all():
        if is_canonical(symmetry.of_action(action, num_segments), num_segments):
            return symmetry
    raise IllegalActionError(f"{action} has no learned counterpart: no end of the rope is in it")


@dataclass(frozen=True)
class Canonical:
    """A rope and an action brought to the learned counterpart."""

    points: NDArray[np.float64]
    """(V, 3) the transformed rope, metres, its own head first."""
    action: Action
    """The canonical action."""
    segments: NDArray[np.float64]
    """(num_segments, 2) where each segment of `points` begins and ends, fractions of its length."""
    symmetry: Symmetry
    """The transformation that led here, its own inverse."""

    @property
    def primitive(self) -> int:
        """The primitive that instantiates the action."""
        return primitive_of(self.action, len(self.segments))


def canonicalise(points: NDArray, action: Action) -> Canonical:
    """Mirror and reverse a rope (V, 3) so that the action becomes canonical.

    Raises:
        IllegalActionError: the action names a segment that the rope does not have.
        DegenerateCurveError: the segments of the rope cannot be read.
    """
    points = np.asarray(points, dtype=np.float64)
    segments = _segments(points.tobytes())
    symmetry = canonical_symmetry(action, len(segments))
    if symmetry.mirror:
        points = points * [1, -1, 1]
    if symmetry.reverse:
        points = points[::-1]
    if symmetry.mirror or symmetry.reverse:
        # Read again, not transformed: rounding would make the law hold to 1e-16 only, and then
        # not at all after the networks' float32.
        segments = _segments(points.tobytes())
    action = symmetry.of_action(action, len(segments))
    return Canonical(np.ascontiguousarray(points), action, segments, symmetry)


@lru_cache(maxsize=64)
def _segments(points: bytes) -> NDArray[np.float64]:
    """`segment_intervals`, read once of a rope that is asked for with every action it allows."""
    segments = segment_intervals(np.frombuffer(points).reshape(-1, 3))
    segments.flags.writeable = False
    return segments

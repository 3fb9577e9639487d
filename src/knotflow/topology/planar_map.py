"""The planar map of a projected open curve: its segments, their two sides, and the faces.

A curve with c crossings has 2c + 1 segments and, when it can be drawn in the plane, c + 1 faces
(Euler: V - E + F = 2 with V = c + 2, E = 2c + 1). The map is one on the sphere: the choice of the
outer face is not part of the topology.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

LEFT = 1
RIGHT = -1

Crossing = tuple[int, int, int]
"""(over, under, sign): 1-based positions along the rope from head to tail, sign +1/-1 (Eq. 1)."""

Side = tuple[int, int]
"""(segment, side): one side of a segment, LEFT or RIGHT as seen walking from head to tail."""


@dataclass(frozen=True)
class PlanarMap:
    """Which face lies on the `left` and on the `right` of every segment.

    Attributes:
        faces: the sides that bound each face, in the order of a walk round it with the face on
            the left hand. A left side is walked forward, a right side backward.
    """

    left: tuple[int, ...]
    right: tuple[int, ...]
    faces: tuple[tuple[Side, ...], ...]

    @property
    def num_segments(self) -> int:
        """Number of segments, 2c + 1; the head's is 0 and the tail's is 2c."""
        return len(self.left)

    @property
    def tail(self) -> int:
        return len(self.left) - 1

    def face(self, segment: int, side: int) -> int:
        """The face on one side (LEFT or RIGHT) of a segment."""
        return self.left[segment] if side == LEFT else self.right[segment]

    def sides_towards(self, segment: int, face: int) -> tuple[int, ...]:
        """The sides of a segment that border a face: none, one, or (LEFT, RIGHT)."""
        return tuple(side for side in (LEFT, RIGHT) if self.face(segment, side) == face)

    def segments_around(self, face: int) -> tuple[int, ...]:
        """The segments that border a face, in rising order."""
        return tuple(sorted({segment for segment, _ in self.faces[face]}))


def trace_faces(crossings: Sequence[Crossing]) -> PlanarMap:
    """The planar map of signed crossings whose positions are a permutation of 1..2c.

    Crossings that cannot be drawn in the plane give fewer than c + 1 faces.
    """
    tail = 2 * len(crossings)
    # What follows each side on a walk round a face. At a crossing the left turn leads onto the
    # other strand: forward where that strand passes from right to left, else backward. Eq. 1: sign
    # +1 means that the under strand, seen from the over strand, passes from right to left, and the
    # over strand, seen from it, left to right. Walking backward, the left hand is the rope's right.
    following: dict[Side, Side] = {(tail, LEFT): (tail, RIGHT), (0, RIGHT): (0, LEFT)}
    for over, under, sign in crossings:
        for position, other, to_left in ((over, under, sign > 0), (under, over, sign < 0)):
            forward, backward = (other, LEFT), (other - 1, RIGHT)
            following[position - 1, LEFT] = forward if to_left else backward
            following[position, RIGHT] = backward if to_left else forward
    face_of: dict[Side, int] = {}
    faces: list[tuple[Side, ...]] = []
    for here in product(range(tail + 1), (LEFT, RIGHT)):
        walk: list[Side] = []
        while here not in face_of:
            face_of[here] = len(faces)
            walk.append(here)
            here = following[here]
        if walk:
            faces.append(tuple(walk))
    left = tuple(face_of[segment, LEFT] for segment in range(tail + 1))
    right = tuple(face_of[segment, RIGHT] for segment in range(tail + 1))
    return PlanarMap(left, right, tuple(faces))

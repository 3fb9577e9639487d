"""The planar map of a projected open curve: its segments, their two sides, and the faces.

A curve with c crossings has 2c + 1 segments and, when it can be drawn in the plane, c + 1 faces
(Euler: V - E + F = 2 with V = c + 2, E = 2c + 1). The map is one on the sphere: the choice of the
outer face is not part of the topology.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
        """Index of the tail segment."""
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
    num_segments = 2 * len(crossings) + 1
    # At position p the left turn leads onto the other strand: forward where that strand passes
    # from right to left, else backward. Eq. 1: sign +1 means that the under strand, seen from the
    # over strand, passes from right to left, and the over strand, seen from it, left to right.
    left_turn: list[Side] = [(0, LEFT)] * num_segments
    right_turn: list[Side] = [(0, LEFT)] * num_segments
    for over, under, sign in crossings:
        for position, other, to_left in ((over, under, sign > 0), (under, over, sign < 0)):
            forward, backward = (other, LEFT), (other - 1, RIGHT)
            left_turn[position] = forward if to_left else backward
            right_turn[position] = backward if to_left else forward

    def following(side: Side) -> Side:
        segment, direction = side
        if direction == LEFT:
            last = segment == num_segments - 1
            return (segment, RIGHT) if last else left_turn[segment + 1]
        # Walking backward along the rope, the left hand is the rope's right.
        return right_turn[segment] if segment else (0, LEFT)

    sides: dict[int, list[int]] = {LEFT: [-1] * num_segments, RIGHT: [-1] * num_segments}
    faces: list[tuple[Side, ...]] = []
    for start in ((segment, side) for segment in range(num_segments) for side in (LEFT, RIGHT)):
        if sides[start[1]][start[0]] >= 0:
            continue
        walk: list[Side] = []
        here = start
        while sides[here[1]][here[0]] < 0:
            sides[here[1]][here[0]] = len(faces)
            walk.append(here)
            here = following(here)
        faces.append(tuple(walk))
    return PlanarMap(tuple(sides[LEFT]), tuple(sides[RIGHT]), tuple(faces))

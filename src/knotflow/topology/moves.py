"""The actions that add crossings: Reidemeister I and II, and Cross (paper Sec. IV, Table I).

Legality is decided in `new_crossings`, from the faces of the planar map. `state` inserts the new
points into the Gauss code and removes them.

Conventions where the geometry of an open curve leaves a choice:

* Cross: the end comes from the common face, so the side of the other segment that borders this
  face gives the sign. Where both its sides do (end segments, bridges), both signs are legal.
  An end that crosses its own segment is an R1, so over == under is illegal for Cross.
* R2: the finger leaves the over segment on its `left` side. Where both sides of the under segment
  border the face that the finger enters, the finger arrives at the side of the same name, as when
  a rope is folded over itself: R2(0,0,1,1) on the trivial state gives [(1,4,+1), (2,3,-1)].
* R2: `over_first` says whether the over strand is the one closer to the head. Table I gives it a
  meaning only where over == under; elsewhere the indices decide and its value is ignored, and
  every list of actions carries the value that agrees with them (+1 exactly if over < under).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from knotflow.topology.action import SIGNS, ForwardAction, IllegalActionError, NewPoint
from knotflow.topology.planar_map import LEFT, Crossing, PlanarMap


@dataclass(frozen=True, order=True)
class R1(ForwardAction):
    """Reidemeister I: twist a loop into the segment `index`, with a crossing of this `sign`.

    `left` is +1 when the new face (the loop) is on the left of the rope, -1 on the right.
    """

    symbol = "R1"
    segment_fields = ("index",)
    mirror_fields, reverse_fields = ("left", "sign"), ("left",)

    index: int
    left: int
    sign: int

    @property
    def split_segments(self) -> tuple[int, ...]:
        return (self.index, self.index)

    @property
    def segments_after(self) -> tuple[int, ...]:
        return (self.index + 1,)  # the loop

    def new_crossings(self, planar_map: PlanarMap) -> tuple[tuple[NewPoint, NewPoint, int], ...]:
        self.check_segments(planar_map.num_segments)
        first, second = (self.index, 0), (self.index, 1)
        # A counter-clockwise loop whose second passage is over has sign +1.
        over, under = (second, first) if self.left == self.sign else (first, second)
        return ((over, under, self.sign),)

    @classmethod
    def legal(cls, planar_map: PlanarMap) -> Iterator[R1]:
        for parameters in product(range(planar_map.num_segments), SIGNS, SIGNS):
            yield cls(*parameters)

    @classmethod
    def last_candidates(cls, crossings: Sequence[Crossing]) -> Iterator[R1]:
        for over, under, sign in crossings:
            if abs(over - under) == 1:
                yield cls(min(over, under) - 1, sign if over > under else -sign, sign)


@dataclass(frozen=True, order=True)
class R2(ForwardAction):
    """Reidemeister II: lay a finger of the segment `over` over the segment `under`.

    Attributes:
        left: +1 when the finger leaves the over segment on its left, -1 on its right.
        over_first: where over == under, +1 when the half closer to the head is over, else -1.
            Ignored where over != under; canonical is then +1 exactly if over < under.
    """

    symbol = "R2"
    segment_fields = ("over", "under")
    mirror_fields, reverse_fields = ("left",), ("left", "over_first")

    over: int
    under: int
    left: int
    over_first: int

    @property
    def split_segments(self) -> tuple[int, ...]:
        return tuple(sorted((self.over, self.over, self.under, self.under)))

    @property
    def is_over_first(self) -> bool:
        """Whether the over strand is the one closer to the head."""
        return self.over_first == 1 if self.over == self.under else self.over < self.under

    @property
    def segments_after(self) -> tuple[int, ...]:
        # The two sides of the bigon: the tip of the finger, and what it lies on.
        first, _, second, _ = self.new_positions
        return (first, second) if self.is_over_first else (second, first)

    def new_crossings(self, planar_map: PlanarMap) -> tuple[tuple[NewPoint, NewPoint, int], ...]:
        self.check_segments(planar_map.num_segments)
        face = planar_map.face(self.over, self.left)
        sides = planar_map.sides_towards(self.under, face)
        if not sides:
            name, other = ("left", "right") if self.left == LEFT else ("right", "left")
            message = (
                f"{self}: the two segments must border a common face, but the face on the {name} "
                f"of segment {self.over}, where its finger leaves, borders segments "
                f"{list(planar_map.segments_around(face))}"
            )
            if planar_map.sides_towards(self.under, planar_map.face(self.over, -self.left)):
                message += f"; segment {self.under} is on its {other}: left={-self.left}"
            raise IllegalActionError(message)
        side = self.left if self.left in sides else sides[0]
        over_rank = under_rank = 0
        if self.over == self.under:
            over_rank, under_rank = (0, 2) if self.over_first == 1 else (2, 0)
        out, back = (self.over, over_rank), (self.over, over_rank + 1)
        near, far = (self.under, under_rank), (self.under, under_rank + 1)
        if side == self.left:
            # The under strand runs against the over strand along the fold: it meets the finger's
            # way back first.
            near, far = far, near
        # From the left of the under strand the finger goes out with sign +1 and back with -1.
        return ((out, near, side), (back, far, -side))

    @classmethod
    def legal(cls, planar_map: PlanarMap) -> Iterator[R2]:
        for over in range(planar_map.num_segments):
            for left in SIGNS:
                for under in planar_map.segments_around(planar_map.face(over, left)):
                    if over == under:
                        yield cls(over, under, left, 1)
                        yield cls(over, under, left, -1)
                    else:
                        yield cls(over, under, left, 1 if over < under else -1)

    @classmethod
    def last_candidates(cls, crossings: Sequence[Crossing]) -> Iterator[R2]:
        by_over = {over: (under, sign) for over, under, sign in crossings}
        for out, (near, sign) in by_over.items():
            far, back_sign = by_over.get(out + 1, (0, 0))
            if back_sign != -sign or abs(near - far) != 1:
                continue
            first_under = min(near, far)
            over = out - 1 - 2 * (first_under < out)
            under = first_under - 1 - 2 * (out < first_under)
            # Two strands side by side, so the bigon that opens on the finger's other side tells
            # where the finger came from.
            left = sign if near > far else -sign
            yield cls(over, under, left, 1 if out < first_under else -1)


@dataclass(frozen=True, order=True)
class Cross(ForwardAction):
    """Cross: lead the rope's head or tail over or under another segment.

    Of `over` and `under`, the segments at the new crossing of this `sign`, one is head or tail.
    """

    symbol = "C"
    segment_fields = ("over", "under")
    mirror_fields, reverse_fields = ("sign",), ()

    over: int
    under: int
    sign: int

    @property
    def split_segments(self) -> tuple[int, ...]:
        return tuple(sorted((self.over, self.under)))

    @property
    def segments_after(self) -> tuple[int, ...]:
        # The two outside the loop between the passages: one is the end segment.
        first, second = self.new_positions
        return (first - 1, second) if self.over < self.under else (second, first - 1)

    def new_crossings(self, planar_map: PlanarMap) -> tuple[tuple[NewPoint, NewPoint, int], ...]:
        self.check_segments(planar_map.num_segments)
        if self.over == self.under:
            raise IllegalActionError(
                f"{self}: a segment that crosses itself makes a loop: R1({self.over},left,sign)"
            )
        ends = (0, planar_map.tail)
        if self.over not in ends and self.under not in ends:
            raise IllegalActionError(
                f"{self}: one of the segments must be the head segment 0 or the tail segment "
                f"{planar_map.tail}"
            )
        signs = _cross_signs(planar_map, self.over, self.under)
        if not signs:
            faces = {planar_map.left[self.over], planar_map.right[self.over]}
            neighbours = {other for face in faces for other in planar_map.segments_around(face)}
            raise IllegalActionError(
                f"{self}: the two segments must border a common face, but segment {self.over} "
                f"shares faces only with {sorted(neighbours - {self.over})}"
            )
        if self.sign not in signs:
            raise IllegalActionError(
                f"{self}: the end can reach the other segment from one side only, "
                f"which makes the sign {signs[0]:+d}"
            )
        return (((self.over, 0), (self.under, 0), self.sign),)

    @classmethod
    def legal(cls, planar_map: PlanarMap) -> Iterator[Cross]:
        tail = planar_map.tail
        pairs = {(end, other) for end in (0, tail) for other in range(tail + 1) if other != end}
        for over, under in sorted(pairs | {(under, over) for over, under in pairs}):
            for sign in _cross_signs(planar_map, over, under):
                yield cls(over, under, sign)

    @classmethod
    def last_candidates(cls, crossings: Sequence[Crossing]) -> Iterator[Cross]:
        last = 2 * len(crossings)
        for over, under, sign in crossings:
            first, second = min(over, under), max(over, under)
            if (first == 1 or second == last) and second - first > 1:
                low, high = first - 1, second - 2
                yield cls(low, high, sign) if over == first else cls(high, low, sign)


def _cross_signs(planar_map: PlanarMap, over: int, under: int) -> tuple[int, ...]:
    """The signs with which the end among two different segments can cross the other one."""
    end, other = (over, under) if over in (0, planar_map.tail) else (under, over)
    # Both sides of an end segment border the one face that the end lies in. The tail moves the
    # way the rope points, the head against it; coming from the other segment's left, an over
    # strand makes sign +1 and an under strand -1 (Eq. 1).
    along = 1 if end == planar_map.tail else -1
    height = 1 if end == over else -1
    sides = planar_map.sides_towards(other, planar_map.left[end])
    return tuple(sorted((side * along * height for side in sides), reverse=True))


ACTION_KINDS: tuple[type[ForwardAction], ...] = (R1, R2, Cross)

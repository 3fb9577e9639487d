"""Actions on topological states: their interface, those that add crossings, Undo and Arrange.

Segments are numbered as in the state before the action.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from operator import index
from typing import ClassVar, Self

from knotflow.topology.planar_map import Crossing, PlanarMap

SIGNS = (1, -1)
UNDO, ARRANGE = "undo", "arrange for"
"""What the text of an Undo and of an Arrange begins with."""

NewPoint = tuple[int, int]
"""(segment, rank): the rank-th point, counted from the head, that an action adds to a segment."""


class IllegalActionError(ValueError):
    """An action that does not exist, or that the state it was applied to does not allow."""


class Action(ABC):
    """An action on a state; `parse_action` reads its `str`."""

    @property
    @abstractmethod
    def segments(self) -> tuple[int, ...]:
        """The segments of the state before that the action involves, over before under."""

    @property
    def over_segment(self) -> int:
        """The segment that will be over (for an Undo: that is over)."""
        return self.segments[0]

    @property
    def under_segment(self) -> int:
        """The segment that will be under (for an Undo: that is under)."""
        return self.segments[-1]

    @abstractmethod
    def check_segments(self, num_segments: int) -> None:
        """Raise IllegalActionError where a state with `num_segments` lacks one of the action's."""

    @abstractmethod
    def mirrored(self) -> Self:
        """The action reflected about a line on the table: `left` and `sign` negated (Sec. V-A)."""

    @abstractmethod
    def reversed(self, num_segments: int) -> Self:
        """The action read from the tail: `left` and `over_first` negated (Sec. V-A).

        Raises:
            IllegalActionError: the action names a segment beyond the last of those before it.
        """


@dataclass(frozen=True, order=True)
class ForwardAction(Action):
    """An action that adds crossings: R1, R2 or Cross (Table I).

    The over segment is the one to grasp, the under segment the one to move toward (Sec. V-A).
    """

    symbol: ClassVar[str]
    segment_fields: ClassVar[tuple[str, ...]]
    mirror_fields: ClassVar[tuple[str, ...]]
    """What `mirrored` negates."""
    reverse_fields: ClassVar[tuple[str, ...]]
    """What `reversed` negates."""

    def __post_init__(self) -> None:
        """Convert numpy integers to int and reject parameters that are invalid in every state."""
        for field in fields(self):
            try:
                value = index(getattr(self, field.name))
            except TypeError:
                raise IllegalActionError(
                    f"{self}: {field.name} must be a whole number, "
                    f"got {getattr(self, field.name)!r}"
                ) from None
            object.__setattr__(self, field.name, value)
            if field.name in self.segment_fields:
                if value < 0:
                    raise IllegalActionError(f"{self}: {field.name} must be 0 or more, got {value}")
            elif value not in SIGNS:
                raise IllegalActionError(f"{self}: {field.name} must be +1 or -1, got {value}")

    def __str__(self) -> str:
        return f"{self.symbol}({','.join(map(str, astuple(self)))})"

    @property
    def segments(self) -> tuple[int, ...]:
        return tuple(getattr(self, name) for name in self.segment_fields)

    def check_segments(self, num_segments: int) -> None:
        for segment in self.segments:
            if segment >= num_segments:
                raise IllegalActionError(
                    f"{self}: there is no segment {segment}; this state has segments "
                    f"0 to {num_segments - 1}"
                )

    @property
    @abstractmethod
    def split_segments(self) -> tuple[int, ...]:
        """The segment of every new point on the rope, in ascending order."""

    @property
    def new_positions(self) -> tuple[int, ...]:
        """The position of every new point in the state after the action, in ascending order."""
        return tuple(segment + rank + 1 for rank, segment in enumerate(self.split_segments))

    @property
    @abstractmethod
    def segments_after(self) -> tuple[int, ...]:
        """The segments, over before under, of the state after that an undo involves."""

    @abstractmethod
    def new_crossings(self, planar_map: PlanarMap) -> tuple[tuple[NewPoint, NewPoint, int], ...]:
        """The (over point, under point, sign) added to a state with this planar map.

        Raises:
            IllegalActionError: the state does not allow the action; says which rule it breaks.
        """

    def mirrored(self) -> Self:
        return replace(self, **{name: -getattr(self, name) for name in self.mirror_fields})

    def reversed(self, num_segments: int) -> Self:
        self.check_segments(num_segments)
        changed = {name: -getattr(self, name) for name in self.reverse_fields}
        for name in self.segment_fields:
            changed[name] = num_segments - 1 - getattr(self, name)
        return replace(self, **changed)

    @classmethod
    @abstractmethod
    def legal(cls, planar_map: PlanarMap) -> Iterator[Self]:
        """Every action of this kind that a state with this planar map allows."""

    @classmethod
    @abstractmethod
    def last_candidates(cls, crossings: Sequence[Crossing]) -> Iterator[Self]:
        """Every action of this kind that may have been the last; some of R2's could not."""


@dataclass(frozen=True)
class Undo(Action):
    """The inverse of an R1, R2 or Cross, whose segments are those of the state after the undo.

    `segments` are of the state before the undo: of R1 the loop; of R2 the tip of the finger and the
    strand it lies on; of Cross those before the first and behind the second passage of the
    crossing, one of which is the end that crosses.
    """

    action: ForwardAction

    def __str__(self) -> str:
        return f"{UNDO} {self.action}"

    @property
    def segments(self) -> tuple[int, ...]:
        return self.action.segments_after

    def pulled_segment(self, num_segments: int) -> int:
        """The segment to pull out of a rope with `num_segments`: loop, finger tip, or rope end.

        Where both segments of a Cross are ends it is the over one, which lies free.
        """
        ends = (0, num_segments - 1)
        under_is_end = self.under_segment in ends and self.over_segment not in ends
        return self.under_segment if under_is_end else self.over_segment

    def other_segment(self, num_segments: int) -> int:
        """The segment that `pulled_segment` is pulled away from; the loop itself for R1."""
        pulled_over = self.pulled_segment(num_segments) == self.over_segment
        return self.under_segment if pulled_over else self.over_segment

    def num_segments_after(self, num_segments: int) -> int:
        """The number of segments that the undo leaves of `num_segments`."""
        return num_segments - len(self.action.split_segments)

    def check_segments(self, num_segments: int) -> None:
        after = self.num_segments_after(num_segments)
        if max(self.action.segments) >= after:
            raise IllegalActionError(
                f"{self}: of the {num_segments} segments, 0 to {num_segments - 1}, it would leave "
                f"{max(after, 0)}, and the action names segment {max(self.action.segments)}"
            )

    def mirrored(self) -> Undo:
        return Undo(self.action.mirrored())

    def reversed(self, num_segments: int) -> Undo:
        self.check_segments(num_segments)
        return Undo(self.action.reversed(self.num_segments_after(num_segments)))


@dataclass(frozen=True)
class Arrange(Action):
    """Keep the state and make room for the wanted action, wherever that is legal (Sec. VIII).

    `TopologicalState.actions` does not list it.

    Raises:
        IllegalActionError: the wanted action is itself an Arrange.
    """

    wanted: Action

    def __post_init__(self) -> None:
        if isinstance(self.wanted, Arrange):
            raise IllegalActionError(f"{self}: the wanted action must change the state")

    def __str__(self) -> str:
        return f"{ARRANGE} {self.wanted}"

    @property
    def segments(self) -> tuple[int, ...]:
        return self.wanted.segments

    def check_segments(self, num_segments: int) -> None:
        self.wanted.check_segments(num_segments)

    def mirrored(self) -> Arrange:
        return Arrange(self.wanted.mirrored())

    def reversed(self, num_segments: int) -> Arrange:
        return Arrange(self.wanted.reversed(num_segments))

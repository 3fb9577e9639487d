"""What topological actions have in common, and what those have that add crossings (Table I)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from operator import index
from typing import ClassVar, Self

from knotflow.topology.faces import Crossing, PlanarMap

SIGNS = (1, -1)

NewPoint = tuple[int, int]
"""(segment, rank): the rank-th point, counted from the head, that an action adds to a segment."""


class IllegalActionError(ValueError):
    """An action that does not exist, or that the state it was applied to does not allow."""


class Action(ABC):
    """An action on a state; `str` gives the compact form that `parse_action` reads.

    Segments are numbered as in the state before the action.
    """

    @property
    @abstractmethod
    def segments(self) -> tuple[int, ...]:
        """The segments of the state before that the action is about, over before under."""

    @property
    def over_segment(self) -> int:
        """The segment that will be over (or is, where the action is undone)."""
        return self.segments[0]

    @property
    def under_segment(self) -> int:
        """The segment that will be under (or is, where the action is undone)."""
        return self.segments[-1]

    @abstractmethod
    def check_segments(self, num_segments: int) -> None:
        """Raise IllegalActionError when a state with so many segments lacks one of the action's."""

    @abstractmethod
    def mirrored(self) -> Self:
        """The action seen in a mirror that stands on the table (Sec. V-A)."""

    @abstractmethod
    def reversed(self, num_segments: int) -> Self:
        """The action read from the other end of a rope with `num_segments` segments (Sec. V-A).

        Raises:
            IllegalActionError: the action names a segment that such a rope does not have.
        """


@dataclass(frozen=True, order=True)
class ForwardAction(Action):
    """What R1, R2 and Cross have in common: they add crossings.

    The over segment is the one to grasp, the under segment the one to move toward (Sec. V-A).
    """

    symbol: ClassVar[str]
    segment_fields: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        """Refuse parameters that no state could give a meaning to."""
        for field in fields(self):
            try:
                value = index(getattr(self, field.name))
            except TypeError:
                raise IllegalActionError(
                    f"{self}: {field.name} must be a whole number, "
                    f"got {getattr(self, field.name)!r}"
                ) from None
            object.__setattr__(self, field.name, value)  # numpy's integers become int
            if field.name in self.segment_fields:
                if value < 0:
                    raise IllegalActionError(f"{self}: {field.name} must be 0 or more, got {value}")
            elif value not in SIGNS:
                raise IllegalActionError(f"{self}: {field.name} must be +1 or -1, got {value}")

    def __str__(self) -> str:
        return f"{self.symbol}({','.join(map(str, astuple(self)))})"

    @property
    def segments(self) -> tuple[int, ...]:
        """The segments the action names, over before under."""
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
    def touched(self) -> tuple[int, ...]:
        """The segment of every new point on the rope, in rising order."""

    @property
    def new_positions(self) -> tuple[int, ...]:
        """The position of every new point in the state after the action, in rising order."""
        return tuple(segment + rank + 1 for rank, segment in enumerate(self.touched))

    @property
    @abstractmethod
    def segments_after(self) -> tuple[int, ...]:
        """The segments of the state after by which the action is taken back, over before under."""

    @abstractmethod
    def new_crossings(self, planar_map: PlanarMap) -> tuple[tuple[NewPoint, NewPoint, int], ...]:
        """The (over point, under point, sign) made in a state with this planar map.

        Raises:
            IllegalActionError: the state does not allow the action; says which rule it breaks.
        """

    def _from_tail(self, segment: int, num_segments: int) -> int:
        """The number of a segment when they are counted from the other end."""
        if segment >= num_segments:
            raise IllegalActionError(
                f"{self}: there is no segment {segment} among {num_segments}, 0 to "
                f"{num_segments - 1}"
            )
        return num_segments - 1 - segment

    @classmethod
    @abstractmethod
    def legal(cls, planar_map: PlanarMap) -> Iterator[Self]:
        """Every action of this kind that a state with this planar map allows."""

    @classmethod
    @abstractmethod
    def last_candidates(cls, crossings: Sequence[Crossing]) -> Iterator[Self]:
        """Every action of this kind that may have been the last; only R2 may offer false ones."""

"""Undoing: a topological action taken back is an action too.

`Undo(Cross(2, 0, 1))` pulls an end back across the strand that it was led across, `Undo(R1(...))`
pulls a loop out, `Undo(R2(...))` a finger. Its parameters are those of the action that is taken
back, so *their* indices speak of the state after the undoing, which has fewer segments, while
`segments`, `over_segment` and `under_segment` speak of the state before, as those of every action:

* R1: the loop, which is both;
* R2: the two sides of the bigon, the tip of the finger over the strand that it lies on;
* Cross: the segments before the first and behind the second passage of the crossing, one of which
  is the rope's end that was led across.
"""

from __future__ import annotations

from dataclasses import dataclass

from knotflow.topology.action import Action, ForwardAction, IllegalActionError

UNDO = "undo"
"""Stands before the action that is taken back in an undoing's `str`."""


@dataclass(frozen=True)
class Undo(Action):
    """The inverse of an R1, R2 or Cross.

    Attributes:
        action: what is taken back; in the state that the undoing leads to it is legal.

    Raises:
        IllegalActionError: the action is itself an undoing, or no action.
    """

    action: ForwardAction

    def __post_init__(self) -> None:
        """Refuse what adds no crossings."""
        if not isinstance(self.action, ForwardAction):
            raise IllegalActionError(f"R1, R2 and Cross can be undone, got {self.action}")

    def __str__(self) -> str:
        return f"{UNDO} {self.action}"

    @property
    def segments(self) -> tuple[int, ...]:
        """As the module says, of the state before the undoing; over before under."""
        return self.action.segments_after

    def pulled_segment(self, num_segments: int) -> int:
        """The segment to pull out of a rope with so many: loop, finger tip, or the rope's end.

        Where both segments of a Cross are ends it is the over one, which lies free.
        """
        ends = (0, num_segments - 1)
        under_is_end = self.under_segment in ends and self.over_segment not in ends
        return self.under_segment if under_is_end else self.over_segment

    def other_segment(self, num_segments: int) -> int:
        """The other one, from which it is pulled away; the loop itself for R1."""
        pulled_over = self.pulled_segment(num_segments) == self.over_segment
        return self.under_segment if pulled_over else self.over_segment

    def num_segments_after(self, num_segments: int) -> int:
        """The number of segments after the undoing of a rope that has `num_segments` before."""
        return num_segments - len(self.action.touched)

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

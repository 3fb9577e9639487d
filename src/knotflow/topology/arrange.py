"""Arranging: a step that keeps the state and makes room for an action (paper Sec. VIII)."""

from __future__ import annotations

from dataclasses import dataclass

from knotflow.topology.action import Action, IllegalActionError

ARRANGE = "arrange for"
"""Stands before the wanted action in an arranging's `str`."""


@dataclass(frozen=True)
class Arrange(Action):
    """Keep the state, and make room for an action that is not done yet.

    No list of actions has it: it is legal wherever the wanted action is, and changes no crossing.

    Attributes:
        wanted: the action that shall succeed afterwards.

    Raises:
        IllegalActionError: the wanted action is itself an arranging.
    """

    wanted: Action

    def __post_init__(self) -> None:
        """Refuse what changes no state."""
        if isinstance(self.wanted, Arrange):
            raise IllegalActionError(f"{self}: one arranges for an action that changes the state")

    def __str__(self) -> str:
        return f"{ARRANGE} {self.wanted}"

    @property
    def segments(self) -> tuple[int, ...]:
        """Those of the wanted action."""
        return self.wanted.segments

    def check_segments(self, num_segments: int) -> None:
        self.wanted.check_segments(num_segments)

    def mirrored(self) -> Arrange:
        return Arrange(self.wanted.mirrored())

    def reversed(self, num_segments: int) -> Arrange:
        return Arrange(self.wanted.reversed(num_segments))

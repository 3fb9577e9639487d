"""Mirror and Reverse, the symmetries that let one primitive serve many actions (paper Sec. V-A).

Both are involutions, they commute, and they commute with applying actions:
`mirror(state).apply(mirror_action(a)) == mirror(state.apply(a))`, and the same for reverse.
"""

from __future__ import annotations

from dataclasses import dataclass

from knotflow.topology.action import Action
from knotflow.topology.state import TopologicalState


def mirror(state: TopologicalState) -> TopologicalState:
    """The state of the rope reflected about a line on the table: all signs change."""
    return state.mirrored()


def reverse(state: TopologicalState) -> TopologicalState:
    """The state of the rope with head and tail exchanged: positions count from the other end."""
    return state.reversed()


def mirror_action(action: Action) -> Action:
    """The action on the reflected rope: opposite `left` and `sign`."""
    return action.mirrored()


def reverse_action(action: Action, num_segments: int) -> Action:
    """The action on the reversed rope: opposite `left` and `over_first`, segments from the tail.

    Args:
        action: an action for a state with `num_segments` segments.
        num_segments: of the state before the action, 2c + 1.

    Raises:
        IllegalActionError: the action names a segment beyond the last.
    """
    return action.reversed(num_segments)


@dataclass(frozen=True)
class Symmetry:
    """One of the four combinations of Mirror and Reverse; each is its own inverse."""

    mirror: bool = False
    reverse: bool = False

    @classmethod
    def all(cls) -> tuple[Symmetry, ...]:
        """The identity, Reverse, Mirror, and both."""
        return tuple(
            cls(mirrored, turned) for mirrored in (False, True) for turned in (False, True)
        )

    def of_state(self, state: TopologicalState) -> TopologicalState:
        """The transformed state."""
        if self.mirror:
            state = state.mirrored()
        return state.reversed() if self.reverse else state

    def of_action(self, action: Action, num_segments: int) -> Action:
        """The transformed action; `num_segments` is that of the state before it."""
        if self.mirror:
            action = action.mirrored()
        return action.reversed(num_segments) if self.reverse else action

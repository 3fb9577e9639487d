"""Mirror and Reverse, the symmetries that let one primitive serve many actions (paper Sec. V-A).

Both are involutions, they commute, and they commute with applying actions:
`state.mirrored().apply(action.mirrored()) == state.apply(action).mirrored()`, likewise reversed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from knotflow.topology.action import Action
from knotflow.topology.polyline import Floats
from knotflow.topology.state import TopologicalState


@dataclass(frozen=True)
class Symmetry:
    """One of the four combinations of Mirror and Reverse; each is its own inverse."""

    mirror: bool = False
    reverse: bool = False

    @classmethod
    def all(cls) -> tuple[Symmetry, ...]:
        """The identity, Reverse, Mirror, and both."""
        return tuple(cls(mirror, reverse) for mirror in (False, True) for reverse in (False, True))

    def of_state(self, state: TopologicalState) -> TopologicalState:
        """The transformed state."""
        if self.mirror:
            state = state.mirrored()
        return state.reversed() if self.reverse else state

    def of_points(self, points: Floats) -> Floats:
        """Ropes (..., V, 3) mirrored at the x axis and read from the other end."""
        if self.mirror:
            points = points * [1, -1, 1]
        return np.ascontiguousarray(points[..., ::-1, :]) if self.reverse else points

    def of_action(self, action: Action, num_segments: int) -> Action:
        """The transformed action; `num_segments` is that of the state before it."""
        if self.mirror:
            action = action.mirrored()
        return action.reversed(num_segments) if self.reverse else action


@cache
def representative(state: TopologicalState) -> tuple[TopologicalState, Symmetry]:
    """The least of a state's four images, and a symmetry that leads from the state to it."""
    images = ((symmetry.of_state(state), symmetry) for symmetry in Symmetry.all())
    return min(images, key=lambda image: image[0])


def distinct_actions(state: TopologicalState) -> list[tuple[Action, TopologicalState]]:
    """The actions of a state with the states they lead to, up to the symmetries of the state."""
    symmetries = [symmetry for symmetry in Symmetry.all() if symmetry.of_state(state) == state]
    count = state.num_segments
    return [
        (action, after)
        for action, after in state.actions()
        if str(action) == min(str(symmetry.of_action(action, count)) for symmetry in symmetries)
    ]

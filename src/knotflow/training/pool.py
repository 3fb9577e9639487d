"""Start shapes to train on: those that were made beforehand, and those that attempts leave behind.

A failed attempt often ends in the state it began in, or in the start state of another task, with
the rope lying otherwise than before. Such shapes cost nothing, differ from all that were made, and
are what a plan meets when it tries again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class StartPool:
    """Start shapes in one topological state."""

    def __init__(self, made: NDArray, recycled_share: float, capacity: int) -> None:
        """Begin with shapes made beforehand.

        Args:
            made: (P, V, 3) metres.
            recycled_share: share of what is drawn that attempts left behind, once there is some.
            capacity: how many of those are kept, the newest.
        """
        self.made = np.asarray(made, dtype=np.float64)
        self.recycled_share, self.capacity = recycled_share, capacity
        self.recycled = self.made[:0]

    def draw(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Shapes (count, V, 3), metres; made ones without repetition where there are enough."""
        out = self.made[rng.choice(len(self.made), count, replace=len(self.made) < count)]
        if len(self.recycled):
            rows = np.flatnonzero(rng.random(count) < self.recycled_share)
            out[rows] = self.recycled[rng.integers(len(self.recycled), size=len(rows))]
        return out

    def recycle(self, points: NDArray) -> None:
        """Take shapes (N, V, 3) that attempts ended in."""
        self.recycled = np.concatenate([self.recycled, points])[-self.capacity :]

    def state_dict(self) -> dict[str, Any]:
        """What attempts left; the made ones are the owner's."""
        return {"recycled": self.recycled}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a `state_dict`."""
        self.recycled = np.asarray(state["recycled"], dtype=np.float64)

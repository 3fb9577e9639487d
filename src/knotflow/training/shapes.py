"""Start shapes to train on: made beforehand, and left behind by attempts.

A failed attempt often ends in the state it began in, or in another one that is trained on, with the
rope lying otherwise than before. Such shapes cost nothing, differ from all that were made, and are
what a plan meets when it tries again. Reinforcement draws some of them beside made ones
(`StartPool`), self-play all but untangled ropes (`ShapeMemory`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.topology import TopologicalState
from knotflow.topology.symmetry import Symmetry, representative


def transformed(points: NDArray, symmetry: Symmetry) -> NDArray[np.float64]:
    """Ropes (..., V, 3) mirrored at the x axis and read from the other end, as the symmetry is."""
    points = np.asarray(points, dtype=np.float64)
    if symmetry.mirror:
        points = points * [1, -1, 1]
    return np.ascontiguousarray(points[..., ::-1, :]) if symmetry.reverse else points


class ShapeMemory:
    """A bounded number of rope shapes in each topological state.

    Mirror and Reverse make up to four states one (Sec. V-A), so a shape of any of them is kept as a
    shape of the representative one, and what is learned about one is known about all.
    """

    def __init__(self, capacity: int) -> None:
        """Keep at most `capacity` shapes a state; a full state forgets a random one for a new."""
        self.capacity = capacity
        self._shapes: dict[TopologicalState, list[NDArray[np.float64]]] = {}

    def __iter__(self) -> Iterator[TopologicalState]:
        """The states that shapes are known of."""
        return iter(self._shapes)

    def __len__(self) -> int:
        """The number of states that shapes are known of."""
        return len(self._shapes)

    def add(self, points: NDArray, state: TopologicalState, rng: np.random.Generator) -> None:
        """Keep a rope (V, 3), metres, that lies at rest in a state."""
        state, symmetry = representative(state)
        shapes = self._shapes.setdefault(state, [])
        shape = transformed(points, symmetry)
        if len(shapes) < self.capacity:
            shapes.append(shape)
        else:
            shapes[rng.integers(self.capacity)] = shape

    def draw(self, state: TopologicalState, rng: np.random.Generator) -> NDArray[np.float64]:
        """A shape (V, 3), metres, of a representative state."""
        shapes = self._shapes[state]
        return shapes[rng.integers(len(shapes))]

    def state_dict(self) -> dict[str, Any]:
        """All shapes, by the states' text."""
        return {str(state): np.stack(shapes) for state, shapes in self._shapes.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a `state_dict`."""
        self._shapes = {
            TopologicalState.parse(name): list(np.asarray(shapes)) for name, shapes in state.items()
        }


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

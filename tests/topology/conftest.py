"""States to hold the laws against."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from knotflow.topology import TopologicalState


@pytest.fixture(scope="session")
def states_by_crossings() -> list[set[TopologicalState]]:
    """All states with 0 to 3 crossings, reached from the trivial one by legal actions."""
    levels: list[set[TopologicalState]] = [{TopologicalState.trivial()}, set(), set(), set()]
    for level in levels[:-1]:
        for state in level:
            for _, following in state.actions():
                if following.num_crossings < len(levels):
                    levels[following.num_crossings].add(following)
    return levels


@pytest.fixture(scope="session")
def random_state() -> Callable[[int, int], TopologicalState]:
    """A function (crossings, seed) to a state reached by random legal actions."""

    def reach(crossings: int, seed: int) -> TopologicalState:
        generator = random.Random(seed)
        state = TopologicalState.trivial()
        while state.num_crossings < crossings:
            following = [after for _, after in state.actions() if after.num_crossings <= crossings]
            state = generator.choice(following)
        return state

    return reach

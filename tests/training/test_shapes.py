from __future__ import annotations

import numpy as np
import pytest

from knotflow.simulation import RopeConfig, resample, state_or_none
from knotflow.topology import TopologicalState, all_states
from knotflow.topology.draw import draw
from knotflow.topology.symmetry import Symmetry, representative
from knotflow.training.shapes import ShapeMemory, transformed


@pytest.mark.parametrize("symmetry", Symmetry.all())
def test_shapes_are_transformed_as_states_are(symmetry):
    for state in all_states(2)[::7]:
        points = resample(draw(state, samples=40), RopeConfig())
        if state_or_none(points) == state:  # resampling may cut a corner
            assert state_or_none(transformed(points, symmetry)) == symmetry.of_state(state)
            np.testing.assert_array_equal(
                transformed(transformed(points, symmetry), symmetry), points
            )


def test_the_memory_keeps_shapes_of_representatives_up_to_its_capacity():
    memory, rng = ShapeMemory(3), np.random.default_rng(0)
    state = TopologicalState.parse("1o2-")
    first, symmetry = representative(state)
    for number in range(5):
        memory.add(np.full((4, 3), float(number)), state, rng)
    assert list(memory) == [first]
    kept = {float(np.abs(memory.draw(first, rng)[0, 0])) for _ in range(100)}
    assert len(kept) == 3
    other = ShapeMemory(3)
    other.load_state_dict(memory.state_dict())
    assert {float(np.abs(other.draw(first, rng)[0, 0])) for _ in range(100)} == kept

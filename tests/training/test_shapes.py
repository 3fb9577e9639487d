from __future__ import annotations

import numpy as np
import pytest

from knotflow.simulation import RopeConfig, resample, state_or_none
from knotflow.topology import TopologicalState, all_states
from knotflow.topology.draw import draw
from knotflow.topology.symmetry import Symmetry, representative
from knotflow.training.shapes import ShapeMemory, StartPool, transformed


@pytest.mark.slow
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


def shapes(count: int, first: int = 0) -> np.ndarray:
    """Ropes that are told apart by their first coordinate."""
    out = np.zeros((count, 41, 3))
    out[:, 0, 0] = np.arange(first, first + count)
    return out


def names(points: np.ndarray) -> list[int]:
    return points[:, 0, 0].astype(int).tolist()


def test_made_shapes_are_drawn_without_repetition_where_there_are_enough(rng):
    pool = StartPool(shapes(10), recycled_share=0.5, capacity=5)
    assert sorted(names(pool.draw(10, rng))) == list(range(10))
    assert set(names(pool.draw(30, rng))) <= set(range(10))


def test_shapes_left_behind_have_their_share(rng):
    pool = StartPool(shapes(10), recycled_share=0.3, capacity=100)
    pool.recycle(shapes(20, first=100))
    drawn = np.array(names(pool.draw(2000, rng)))
    assert (drawn >= 100).mean() == pytest.approx(0.3, abs=0.05)


def test_the_newest_are_kept(rng):
    pool = StartPool(shapes(1), recycled_share=1.0, capacity=3)
    pool.recycle(shapes(2, first=100))
    pool.recycle(shapes(2, first=200))
    assert set(names(pool.draw(100, rng))) == {101, 200, 201}


def test_a_pool_goes_on_from_its_state(rng):
    pool = StartPool(shapes(4), recycled_share=0.5, capacity=5)
    pool.recycle(shapes(3, first=100))
    again = StartPool(shapes(4), recycled_share=0.5, capacity=5)
    again.load_state_dict(pool.state_dict())
    draws = [p.draw(8, np.random.default_rng(1)) for p in (pool, again)]
    np.testing.assert_array_equal(*draws)

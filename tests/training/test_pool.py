from __future__ import annotations

import numpy as np
import pytest

from knotflow.training.pool import StartPool


def shapes(count: int, first: int = 0) -> np.ndarray:
    """Ropes that are told apart by their first coordinate."""
    out = np.zeros((count, 41, 3))
    out[:, 0, 0] = np.arange(first, first + count)
    return out


def names(points: np.ndarray) -> list[int]:
    return points[:, 0, 0].astype(int).tolist()


@pytest.fixture
def rng():
    return np.random.default_rng(0)


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

import numpy as np
import pytest

from knotflow.seeding import rng_of


def test_trailing_zeros_make_another_stream():
    draws = {tuple(rng_of(20, *path).integers(0, 2**63, 4)) for path in [(3,), (3, 0), (3, 0, 0)]}
    assert len(draws) == 3


def test_streams_are_reproducible():
    assert np.array_equal(rng_of(1, 2).random(3), rng_of(1, 2).random(3))


def test_a_negative_seed_is_named():
    with pytest.raises(ValueError, match="a seed is 0 or more, got -1"):
        rng_of(-1)

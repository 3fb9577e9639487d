"""Random streams by a seed and a path of numbers."""

from __future__ import annotations

import numpy as np


def rng_of(seed: int, *path: int) -> np.random.Generator:
    """A stream of its own for every seed and path; (3,) and (3, 0) are two.

    A list [seed, *path] as NumPy's seed would not do: it ignores zeros at the end.

    Raises:
        ValueError: a negative seed.
    """
    if seed < 0:
        raise ValueError(f"a seed is 0 or more, got {seed}")
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=path))

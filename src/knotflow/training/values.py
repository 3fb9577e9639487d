"""The value of a rope for an action: how well the action can be done from it (Sec. V-B c)."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.primitives.primitive import Primitive
from knotflow.threads import one_thread

CHUNK = 64
"""Ropes that are searched at a time, and chunks side by side; bounds memory."""


def best_values(primitive: Primitive, states: TensorDict, rng: np.random.Generator) -> Tensor:
    """`Primitive.values` (N,) of ropes [N]: many, as a replay buffer has, on all cores.

    Raises:
        ValueError: the primitive has no critic.
    """
    chunks = [states[begin : begin + CHUNK] for begin in range(0, len(states), CHUNK)]
    noises = [primitive.value_noise(len(some), rng) for some in chunks]
    with one_thread(), ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(primitive.values, chunks, noises))
    return torch.cat(found) if found else torch.zeros(0)

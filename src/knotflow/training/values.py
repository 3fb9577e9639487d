"""The value of a rope for an action: how well the action can be done from it (Sec. V-B c)."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from knotflow.primitives.cem import cross_entropy, standard_normal
from knotflow.primitives.networks import SPLINE
from knotflow.primitives.primitive import Primitive
from knotflow.threads import one_thread

CHUNK = 64
"""Ropes that are searched at a time, and chunks side by side; bounds memory."""


def best_values(
    primitive: Primitive, states: TensorDict, population: int, rng: np.random.Generator
) -> Tensor:
    """max Q (N,), in 0..1, of ropes [N] encoded for an action of this primitive.

    It is the value that `Primitive.search` finds, for ropes whose frames were not kept, and with a
    population of one's choice: a replay buffer has thousands of ropes.

    Raises:
        ValueError: the primitive has no actor or no critic.
    """
    if primitive.actor is None or primitive.critic is None:
        raise ValueError(
            f"the value of a rope takes actor and critic; this primitive is {primitive.config}"
        )
    cem, actor = primitive.config.cem, primitive.actor

    @torch.no_grad()
    def search(some: TensorDict, noise: Tensor) -> Tensor:
        mean, factor = actor(some)
        score = primitive.scorer(some, 1)
        return cross_entropy(score, mean, factor, noise, min(cem.elites, population))[1].exp()

    chunks = [states[begin : begin + CHUNK] for begin in range(0, len(states), CHUNK)]
    noises = [
        standard_normal(rng, (cem.iterations, len(some), population, SPLINE)) for some in chunks
    ]
    with one_thread(), ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(search, chunks, noises))
    return torch.cat(found) if found else torch.zeros(0)

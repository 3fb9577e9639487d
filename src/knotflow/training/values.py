"""The value of a rope for an action: how well the action can be done from it (Sec. V-B c)."""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from knotflow.primitives.cem import cross_entropy, standard_normal
from knotflow.primitives.networks import SPLINE
from knotflow.primitives.primitive import Primitive

CHUNK = 64
"""Ropes that are searched at a time; bounds memory."""


@torch.no_grad()
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
    cem = primitive.config.cem
    found = []
    for begin in range(0, len(states), CHUNK):
        some = states[begin : begin + CHUNK]
        mean, factor = primitive.actor(some)
        noise = standard_normal(rng, (cem.iterations, len(some), population, SPLINE))
        score = primitive.scorer(some, 1)
        _, best = cross_entropy(score, mean, factor, noise, min(cem.elites, population))
        found.append(best.exp())
    return torch.cat(found) if found else torch.zeros(0)

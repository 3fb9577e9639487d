"""The behaviour policy (Fig. 5, black arrows): splines are the policy's, the critic's best from a
widened Gaussian of the actor, or drawn from this Gaussian."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.samplers.primitives.encoding import Encoded
from knotflow.samplers.primitives.networks import SPLINE
from knotflow.samplers.primitives.primitive import Primitive, cross_entropy, standard_normal
from knotflow.training.config import ExplorationConfig

POLICY, SEARCH, SPREAD = 0, 1, 2
"""The three ways in which a spline is proposed."""


@torch.no_grad()
def explore(
    primitive: Primitive,
    encoded: Encoded,
    count: int,
    config: ExplorationConfig,
    progress: float,
    rng: np.random.Generator,
    use_next_value: bool = False,
) -> tuple[Tensor, NDArray[np.int64]]:
    """Splines (S, count, 6) in network space to try on S ropes, and the way (S,) of each rope's.

    `progress` is 0 in the first round and 1 in the last; with `use_next_value` searches are for the
    next action's value as well.
    """
    left = 1 + progress * (config.last - 1)
    search = left * config.search if primitive.critic is not None else 0.0
    spread = left * config.spread
    ways = rng.choice(3, len(encoded.frames), p=[1 - search - spread, search, spread])
    splines = torch.empty(len(ways), count, SPLINE)
    for way in (POLICY, SEARCH, SPREAD):
        if not len(rows := np.flatnonzero(ways == way)):
            continue
        some = Encoded(encoded.states[torch.from_numpy(rows)], encoded.frames[rows])
        if way == POLICY:
            found = primitive.search(some, count, rng, use_next_value)[0]
        elif way == SEARCH:
            found = _search(primitive, some, count, config, rng, use_next_value)
        else:
            noise = standard_normal(rng, (len(rows), count, SPLINE))
            if primitive.actor is None:
                # A critic's wide Gaussian hardly ever succeeds: stay near its choice.
                best = primitive.search(some, count, rng, use_next_value)[0]
                found = best + config.floor * noise
            else:
                mean, factor = _widened(primitive, some, config)
                found = mean[:, None] + noise @ factor.mT
        splines[torch.from_numpy(rows)] = found
    return splines, ways


def _search(
    primitive: Primitive,
    encoded: Encoded,
    count: int,
    config: ExplorationConfig,
    rng: np.random.Generator,
    use_next_value: bool,
) -> Tensor:
    mean, factor = _widened(primitive, encoded, config)
    cem = primitive.config.cem
    found, _ = cross_entropy(
        primitive.scorer(encoded.states, use_next_value),
        mean.repeat_interleave(count, 0),
        factor.repeat_interleave(count, 0),
        standard_normal(rng, (config.iterations, len(mean) * count, cem.population, SPLINE)),
        cem.elites,
    )
    return found.reshape(len(mean), count, SPLINE)


def _widened(
    primitive: Primitive, encoded: Encoded, config: ExplorationConfig
) -> tuple[Tensor, Tensor]:
    """The actor's Gaussian, widened; that of a critic-only policy is wide enough."""
    mean, factor = primitive.gaussian(encoded.states)
    if primitive.actor is None:
        return mean, factor
    floor = config.floor**2 * torch.eye(SPLINE)
    return mean, torch.linalg.cholesky(config.widening**2 * factor @ factor.mT + floor)

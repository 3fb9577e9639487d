"""The behaviour policy of the reinforcement stage (Fig. 5, black arrows), and how it explores.

The policy alone would only try again what it already does: an actor that fits the successes of its
own narrow samples stays where it is, and where it never succeeds, it never learns. So of the
splines that are tried, some are the policy's, some are the critic's best in a wider neighbourhood
of the actor's mean (what a critic overestimates is then found out), and some are drawn from this
wider neighbourhood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from knotflow.primitives.cem import cross_entropy
from knotflow.primitives.encoding import Encoded
from knotflow.primitives.networks import SPLINE
from knotflow.primitives.primitive import Primitive

POLICY, SEARCH, SPREAD = 0, 1, 2
"""The three ways in which a spline is proposed."""


@dataclass
class ExplorationConfig:
    """Shares of the three ways, and how wide the wider neighbourhood is."""

    search: float = 0.4
    """Share of splines that a search in the wider neighbourhood finds; the policy's without
    critic."""
    spread: float = 0.3
    """Share of splines drawn from the wider neighbourhood; the rest are the policy's."""
    last: float = 0.3
    """Both shares fall to this part of themselves, evenly over the rounds."""
    widening: float = 1.5
    """Factor on the actor's spread."""
    floor: float = 0.25
    """Standard deviation added to it in every direction, whitened units."""
    iterations: int = 3
    """Iterations of the wide search."""


@torch.no_grad()
def explore(
    primitive: Primitive,
    seen: Encoded,
    count: int,
    config: ExplorationConfig,
    progress: float,
    rng: np.random.Generator,
) -> tuple[Tensor, np.ndarray]:
    """Splines (S, count, 6) in network space to try on S ropes, and the way (S, count) of each.

    `progress` runs from 0 in the first round to 1 in the last.
    """
    ropes = len(seen.frames)
    left = 1 + progress * (config.last - 1)
    search = left * config.search if primitive.critic is not None else 0.0
    spread_share = left * config.spread
    ways = rng.choice(3, (ropes, count), p=[1 - search - spread_share, search, spread_share])
    policy, _ = primitive.search(seen, count, rng)
    mean, factor = primitive.gaussian(seen)
    if primitive.actor is not None:
        floor = config.floor**2 * torch.eye(SPLINE)
        factor = torch.linalg.cholesky(config.widening**2 * factor @ factor.mT + floor)
        noise = torch.from_numpy(rng.standard_normal((ropes, count, SPLINE), dtype=np.float32))
        spread = mean[:, None] + noise @ factor.mT
    else:
        # The wide Gaussian of a critic-only policy hardly ever succeeds: stay near its choice.
        noise = torch.from_numpy(rng.standard_normal((ropes, count, SPLINE), dtype=np.float32))
        spread = policy + config.floor * noise
    found = policy
    if primitive.critic is not None:
        cem = primitive.config.cem
        shape = (config.iterations, ropes * count, cem.population, SPLINE)
        numbers = torch.from_numpy(rng.standard_normal(shape, dtype=np.float32))
        flat, _ = cross_entropy(
            primitive.scorer(seen, count),
            mean.repeat_interleave(count, 0),
            factor.repeat_interleave(count, 0),
            numbers,
            cem.elites,
        )
        found = flat.reshape(policy.shape)
    way = torch.from_numpy(ways)[..., None]
    return torch.where(way == POLICY, policy, torch.where(way == SEARCH, found, spread)), ways

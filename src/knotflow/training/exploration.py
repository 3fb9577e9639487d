"""The behaviour policy of the reinforcement stage (Fig. 5, black arrows), and how it explores.

The policy alone would only try again what it already does: an actor that fits the successes of its
own narrow samples stays where it is, and where it never succeeds, it never learns. So of the
splines that are tried, some are the policy's, some are the critic's best in a wider neighbourhood
of the actor's mean (what a critic overestimates is then found out), and some are drawn from this
wider neighbourhood.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from knotflow.samplers.primitives.cem import cross_entropy, standard_normal
from knotflow.samplers.primitives.encoding import Encoded
from knotflow.samplers.primitives.networks import SPLINE
from knotflow.samplers.primitives.primitive import Primitive
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
    onward: bool = False,
) -> tuple[Tensor, np.ndarray]:
    """Splines (S, count, 6) in network space to try on S ropes, and the way (S,) of each rope's.

    `progress` runs from 0 in the first round to 1 in the last; `onward` searches also for the value
    of what a spline leaves.
    """
    left = 1 + progress * (config.last - 1)
    search = left * config.search if primitive.critic is not None else 0.0
    spread = left * config.spread
    ways = rng.choice(3, len(encoded.frames), p=[1 - search - spread, search, spread])
    splines = torch.empty(len(ways), count, SPLINE)
    for way, propose in ((POLICY, _policy), (SEARCH, _search), (SPREAD, _spread)):
        rows = np.flatnonzero(ways == way)
        if len(rows):
            some = Encoded(encoded.states[torch.from_numpy(rows)], encoded.frames[rows])
            splines[torch.from_numpy(rows)] = propose(primitive, some, count, config, rng, onward)
    return splines, ways


def _policy(
    primitive: Primitive,
    encoded: Encoded,
    count: int,
    config: ExplorationConfig,
    rng: np.random.Generator,
    onward: bool,
) -> Tensor:
    return primitive.search(encoded, count, rng, onward)[0]


def _search(
    primitive: Primitive,
    encoded: Encoded,
    count: int,
    config: ExplorationConfig,
    rng: np.random.Generator,
    onward: bool,
) -> Tensor:
    mean, factor = _wider(primitive, encoded, config)
    cem = primitive.config.cem
    found, _ = cross_entropy(
        primitive.scorer(encoded.states, onward),
        mean.repeat_interleave(count, 0),
        factor.repeat_interleave(count, 0),
        standard_normal(rng, (config.iterations, len(mean) * count, cem.population, SPLINE)),
        cem.elites,
    )
    return found.reshape(len(mean), count, SPLINE)


def _spread(
    primitive: Primitive,
    encoded: Encoded,
    count: int,
    config: ExplorationConfig,
    rng: np.random.Generator,
    onward: bool,
) -> Tensor:
    noise = standard_normal(rng, (len(encoded.frames), count, SPLINE))
    if primitive.actor is None:
        # The wide Gaussian of a critic-only policy hardly ever succeeds: stay near its choice.
        return primitive.search(encoded, count, rng, onward)[0] + config.floor * noise
    mean, factor = _wider(primitive, encoded, config)
    return mean[:, None] + noise @ factor.mT


def _wider(
    primitive: Primitive, encoded: Encoded, config: ExplorationConfig
) -> tuple[Tensor, Tensor]:
    """The actor's Gaussian, widened; the wide one of a critic-only policy is wide enough."""
    mean, factor = primitive.gaussian(encoded.states)
    if primitive.actor is None:
        return mean, factor
    floor = config.floor**2 * torch.eye(SPLINE)
    return mean, torch.linalg.cholesky(config.widening**2 * factor @ factor.mT + floor)

"""One topological motion primitive: its networks, and cross-entropy search with its critic.

Many distinct proposals a rope are wanted, so each is a search of its own, and all searches of all
ropes run as one batch; TorchRL's CEMPlanner returns one elite mean a state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor, nn

from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.encoding import Encoded
from knotflow.samplers.primitives.networks import SPLINE, Actor, Critic, log_value
from knotflow.topology.polyline import Floats

Score = Callable[[Tensor], Tensor]
"""Values (R, P) of splines (R, P, 6) of R searches; higher is better."""


def cross_entropy(
    score: Score, mean: Tensor, factor: Tensor, noise: Tensor, elites: int
) -> tuple[Tensor, Tensor]:
    """Run R searches by the cross-entropy method at once (Fig. 5, Sec. VII-B1).

    Args:
        score: values of splines.
        mean: (R, 6) of the first Gaussian of each search.
        factor: (R, 6, 6) lower Cholesky factor of its covariance.
        noise: (iterations, R, P, 6) standard normal numbers, all the randomness there is.
        elites: number of best splines kept, at most P.

    Returns:
        The mean of the last elites (R, 6), and its value (R,).
    """
    for kept, _ in _iterate(score, mean, factor, noise, elites):
        mean = kept.mean(dim=1)
    return mean, score(mean[:, None])[:, 0]


def highest_value(score: Score, mean: Tensor, factor: Tensor, noise: Tensor, elites: int) -> Tensor:
    """The highest value (R,) among the last splines of `cross_entropy` with these arguments."""
    best = mean.new_zeros(len(mean))
    for _, values in _iterate(score, mean, factor, noise, elites):
        best = values[:, 0]
    return best


def _iterate(
    score: Score, mean: Tensor, factor: Tensor, noise: Tensor, elites: int
) -> Iterator[tuple[Tensor, Tensor]]:
    """The elites (R, elites, 6) of each iteration, best first, and their values (R, elites)."""
    for numbers in noise:
        splines = mean[:, None] + numbers @ factor.mT  # (R, P, 6)
        values, order = score(splines).topk(elites, dim=1)
        kept = splines.gather(1, order[..., None].expand(-1, -1, splines.shape[-1]))
        yield kept, values
        mean = kept.mean(dim=1)
        if len(kept):  # of no rope PyTorch warns that there are no degrees of freedom
            factor = torch.diag_embed(kept.std(dim=1, correction=0) + 1e-3)


def standard_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Tensor:
    """Standard normal numbers, float32, from NumPy's generator."""
    return torch.from_numpy(rng.standard_normal(shape, dtype=np.float32))


class Primitive(nn.Module):
    """Actor and critic of one set of actions, either of which a variant may lack."""

    def __init__(self, config: PrimitiveConfig) -> None:
        super().__init__()
        self.config = config
        self.actor = None if config.variant == "critic_only" else Actor(config.network)
        self.critic = None if config.variant == "actor_only" else Critic(config.network)

    @torch.no_grad()
    def search(
        self,
        encoded: Encoded,
        count: int,
        rng: np.random.Generator,
        use_next_value: bool = False,
        first: tuple[Tensor, Tensor] | None = None,
        iterations: int | None = None,
    ) -> tuple[Tensor, Tensor | None]:
        """Splines (S, count, 6) in network space and their values (S, count), if there is a critic.

        With a critic every spline is the outcome of a search of its own, for success or, if
        `use_next_value`, for success times the value of the next state, from the Gaussian `first`,
        by default `gaussian`.
        """
        cem, ropes = self.config.cem, len(encoded.frames)
        mean, factor = first or self.gaussian(encoded.states)
        if self.critic is None:
            noise = standard_normal(rng, (ropes, count, SPLINE))
            return mean[:, None] + noise @ factor.mT, None
        iterations = self._num_iterations if iterations is None else iterations
        found, log_values = cross_entropy(
            self.scorer(encoded.states, use_next_value),
            mean.repeat_interleave(count, 0),
            factor.repeat_interleave(count, 0),
            standard_normal(rng, (iterations, ropes * count, cem.population, SPLINE)),
            cem.elites,
        )
        return found.reshape(ropes, count, SPLINE), log_values.exp().reshape(ropes, count)

    @torch.no_grad()
    def values(self, states: TensorDict, noise: Tensor, use_next_value: bool = False) -> Tensor:
        """Max Q (S,), 0..1, over splines, of encoded ropes [S] (Sec. V-B c).

        `noise` is `value_noise` of as many ropes, all the randomness there is.

        Raises:
            ValueError: there is no critic.
        """
        elites = min(self.config.cem.elites, self.config.cem.valued)
        score = self.scorer(states, use_next_value)
        return highest_value(score, *self.gaussian(states), noise, elites).exp()

    def value_noise(self, ropes: int, rng: np.random.Generator) -> Tensor:
        """Standard normal numbers (iterations, ropes, `valued`, 6) for `values`."""
        return standard_normal(rng, (self._num_iterations, ropes, self.config.cem.valued, SPLINE))

    @property
    def _num_iterations(self) -> int:
        cem = self.config.cem
        return cem.critic_only_iterations if self.actor is None else cem.iterations

    @torch.no_grad()
    def success_probability(self, encoded: Encoded, splines: Floats) -> Floats:
        """Success probabilities (S, N) of world splines (S, N, 6) on S ropes.

        Raises:
            ValueError: there is no critic.
        """
        network = torch.from_numpy(encoded.frames.to_network(splines)).float()
        values: Floats = self.scorer(encoded.states)(network).exp().double().numpy()
        return values

    def gaussian(self, states: TensorDict) -> tuple[Tensor, Tensor]:
        """Mean (S, 6) and Cholesky factor (S, 6, 6) of the actor, or of the wide Gaussian."""
        if self.actor is not None:
            mean, factor = self.actor(states)
            return mean, factor
        ropes = len(states)
        factor = self.config.cem.wide_spread * torch.eye(SPLINE).expand(ropes, SPLINE, SPLINE)
        return torch.zeros(ropes, SPLINE), factor

    def scorer(self, states: TensorDict, use_next_value: bool = False) -> Score:
        """The critic's log values (R, P) of splines (R, P, 6), of as many searches on each rope.

        Raises:
            ValueError: there is no critic.
        """
        critic = self.critic
        if critic is None:
            raise ValueError(f"a primitive of variant {self.config.variant} has no critic")
        features = critic.features(states)

        def score(splines: Tensor) -> Tensor:
            of_ropes = splines.reshape(len(states), -1, SPLINE)
            logits = critic.score(features, states, of_ropes)
            return log_value(logits, use_next_value).reshape(splines.shape[:2])

        return score

"""One topological motion primitive: its networks, and how splines are proposed with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor, nn

from knotflow.samplers.primitives.cem import cross_entropy, standard_normal
from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.encoding import Encoded, encode
from knotflow.samplers.primitives.networks import SPLINE, Actor, Critic, log_value
from knotflow.topology import Action


class Primitive(nn.Module):
    """Actor and critic of one set of actions, either of which a variant may lack."""

    def __init__(self, config: PrimitiveConfig) -> None:
        super().__init__()
        self.config = config
        self.actor = None if config.variant == "critic_only" else Actor(config.network)
        self.critic = None if config.variant == "actor_only" else Critic(config.network)

    def propose(
        self, points: NDArray, actions: Sequence[Action], count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Splines (S, count, 6) for ropes (S, V, 3) with an action each, world frame."""
        encoded = encode(points, actions)
        return encoded.frames.to_world(self.search(encoded, count, rng)[0].numpy())

    @torch.no_grad()
    def search(
        self, encoded: Encoded, count: int, rng: np.random.Generator, onward: bool = False
    ) -> tuple[Tensor, Tensor | None]:
        """Splines (S, count, 6) in network space and their values (S, count), if there is a critic.

        With a critic every spline is the outcome of a search of its own, for success alone or, if
        `onward`, for what it leaves as well.
        """
        cem, ropes = self.config.cem, len(encoded.frames)
        mean, factor = self.gaussian(encoded.states)
        if self.critic is None:
            noise = standard_normal(rng, (ropes, count, SPLINE))
            return mean[:, None] + noise @ factor.mT, None
        found, best = cross_entropy(
            self.scorer(encoded.states, onward),
            mean.repeat_interleave(count, 0),
            factor.repeat_interleave(count, 0),
            standard_normal(rng, (self._iterations, ropes * count, cem.population, SPLINE)),
            cem.elites,
        )
        return found.reshape(ropes, count, SPLINE), best.exp().reshape(ropes, count)

    @torch.no_grad()
    def values(self, states: TensorDict, noise: Tensor, onward: bool = False) -> Tensor:
        """max Q (S,), in 0..1, of ropes [S] (Sec. V-B c): what the best spline found is worth.

        Args:
            states: encoded ropes.
            noise: `value_noise` of as many ropes, all the randomness there is.
            onward: of a spline counts what it leaves as well, not success alone.

        Raises:
            ValueError: there is no critic.
        """
        elites = min(self.config.cem.elites, self.config.cem.valued)
        score = self.scorer(states, onward)
        return cross_entropy(score, *self.gaussian(states), noise, elites)[1].exp()

    def value_noise(self, ropes: int, rng: np.random.Generator) -> Tensor:
        """Standard normal numbers (iterations, ropes, `valued`, 6) for `values`."""
        return standard_normal(rng, (self._iterations, ropes, self.config.cem.valued, SPLINE))

    @property
    def _iterations(self) -> int:
        cem = self.config.cem
        return cem.critic_only_iterations if self.actor is None else cem.iterations

    @torch.no_grad()
    def judged(self, encoded: Encoded, splines: NDArray) -> NDArray[np.float64]:
        """Probabilities (S, N) of success, of splines (S, N, 6) of the world on S ropes.

        Raises:
            ValueError: there is no critic.
        """
        network = torch.from_numpy(encoded.frames.to_network(splines)).float()
        values: NDArray[np.float64] = self.scorer(encoded.states)(network).exp().double().numpy()
        return values

    def gaussian(self, states: TensorDict) -> tuple[Tensor, Tensor]:
        """Mean (S, 6) and Cholesky factor (S, 6, 6) of the actor, or of the wide Gaussian."""
        if self.actor is not None:
            return self.actor(states)
        ropes = len(states)
        factor = self.config.cem.wide_spread * torch.eye(SPLINE).expand(ropes, SPLINE, SPLINE)
        return torch.zeros(ropes, SPLINE), factor

    def scorer(self, states: TensorDict, onward: bool = False) -> Callable[[Tensor], Tensor]:
        """The critic of as many searches on each rope: splines (R, P, 6) -> log values (R, P).

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
            return log_value(logits, onward).reshape(splines.shape[:2])

        return score

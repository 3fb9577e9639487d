"""One topological motion primitive: its networks, and how splines are proposed with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor, nn

from knotflow.primitives.cem import CemConfig, cross_entropy
from knotflow.primitives.encoding import CONTROL_FEATURES, Encoded, encode
from knotflow.primitives.networks import SPLINE, Actor, Critic, NetworkConfig
from knotflow.topology import Action

Variant = Literal["actor_critic", "actor_only", "critic_only"]
VARIANTS: tuple[str, ...] = get_args(Variant)


@dataclass
class PrimitiveConfig:
    """What a primitive is made of."""

    variant: str = "actor_critic"
    """Which networks there are (Sec. VII-B1): actor_critic, actor_only or critic_only."""
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the networks."""
    cem: CemConfig = field(default_factory=CemConfig)
    """The search for splines that the critic thinks best."""

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise ValueError(
                f"unknown variant {self.variant!r} of a primitive; there are {', '.join(VARIANTS)}"
            )


class Primitive(nn.Module):
    """Actor and critic of one set of actions, either of which a variant may lack."""

    def __init__(self, config: PrimitiveConfig) -> None:
        super().__init__()
        self.config = config
        self.actor = None if config.variant == "critic_only" else Actor(config.network)
        self.critic = None if config.variant == "actor_only" else Critic(config.network)

    def propose(
        self, points: NDArray, actions: list[Action], count: int, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Splines (S, count, 6) for ropes (S, V, 3) with an action each, world frame."""
        seen = encode(points, actions)
        return seen.frames.to_world(self.search(seen, count, rng)[0].numpy())

    @torch.no_grad()
    def search(
        self, seen: Encoded, count: int, rng: np.random.Generator
    ) -> tuple[Tensor, Tensor | None]:
        """Splines (S, count, 6) in network space and their critic logits (S, count), if any.

        With a critic every spline is the outcome of a search of its own.
        """
        states, cem = seen.states, self.config.cem
        ropes = len(seen.frames)
        if self.actor is None:
            mean = torch.zeros(ropes, SPLINE)
            factor = cem.wide_spread * torch.eye(SPLINE).expand(ropes, SPLINE, SPLINE)
        else:
            mean, factor = self.actor(states)
        if self.critic is None:
            noise = _normal(rng, (ropes, count, SPLINE))
            return mean[:, None] + noise @ factor.transpose(1, 2), None
        iterations = cem.critic_only_iterations if self.actor is None else cem.iterations
        noise = _normal(rng, (iterations, ropes * count, cem.population, SPLINE))
        features = self.critic.features(states)
        owner = torch.arange(ropes).repeat_interleave(count * cem.population)

        def score(splines: Tensor) -> Tensor:
            assert self.critic is not None
            values = self.critic.score(features, states, splines.reshape(-1, SPLINE), owner)
            return values.reshape(splines.shape[:2])

        found, best = cross_entropy(
            score,
            mean.repeat_interleave(count, 0),
            factor.repeat_interleave(count, 0),
            noise,
            cem.elites,
        )
        return found.reshape(ropes, count, SPLINE), best.reshape(ropes, count)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Tensor:
    return torch.from_numpy(rng.standard_normal(shape, dtype=np.float32))

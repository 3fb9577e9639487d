"""What a primitive is made of, as the configuration says it; read without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

VARIANTS = ("actor_critic", "actor_only", "critic_only")
SHIPPED_PRIMITIVES = Path(__file__).parent / "data"
"""The library that comes with knotflow; `PrimitiveLibrary.load` reads it."""


@dataclass
class NetworkConfig:
    """Actor and critic."""

    actor: str = "gaussian"
    """One Gaussian over splines, or as the authors' code a categorical over the rope's nodes for
    the grasp and a Gaussian over the rest given the node ("nodes")."""
    critic_grasp: str = "all"
    """How the critic is told the grasp: all, its number, position and direction; or as the authors'
    code its "position" alone."""

    lstm: int = 32
    """Hidden size of each stream's LSTM."""
    attention: int = 16
    """Size of queries, keys and values."""
    stream: int = 64
    """Size of each stream's MLP."""
    feature: int = 96
    """Size of the rope's feature."""
    head: int = 128
    """Hidden size of the actor's and the critic's head."""
    sites: int = 6
    """Places along a spline at which the critic looks up the rope."""
    lookups: int = 4
    """Look-ups at each place, near and far."""
    lookup: int = 16
    """Size of what a look-up brings."""
    kinds: int = 0
    """Kinds of actions that one primitive distinguishes by a one-hot input; 0 for a single one."""
    smallest_spread: float = 0.05
    """Least standard deviation of the actor along any direction, normalised units."""
    initial_spread: float = 0.5
    """Standard deviation of an untrained actor, normalised units."""


@dataclass
class CemConfig:
    """How a spline is searched for."""

    iterations: int = 1
    """Iterations from the actor's Gaussian (Sec. VII-B1)."""
    critic_only_iterations: int = 10
    """Iterations from a wide Gaussian, without an actor (Sec. VII-B1)."""
    population: int = 24
    """Splines scored in each iteration of a search from the actor's Gaussian."""
    critic_only_population: int = 256
    """The same from a wide Gaussian."""
    valued: int = 64
    """The same where the value of the best one is wanted alone."""
    elites: int = 12
    """Best splines of a population, which the next one is fitted to."""
    full_covariance: bool = False
    """Whether the next one has the elites' covariance, or its diagonal."""
    returns: str = "mean"
    """What a search returns: the mean of the last elites, or the best of them."""
    wide_spread: float = 1.3
    """Standard deviation of the wide Gaussian about 0, normalised units."""


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
        for name, value, known in (
            ("variant", self.variant, VARIANTS),
            ("network.actor", self.network.actor, ("gaussian", "nodes")),
            ("network.critic_grasp", self.network.critic_grasp, ("all", "position")),
            ("cem.returns", self.cem.returns, ("mean", "best")),
        ):
            if value not in known:
                raise ValueError(
                    f"unknown {name} {value!r} of a primitive; there are {', '.join(known)}"
                )
        for name in ("iterations", "critic_only_iterations", "valued"):
            if not (value := getattr(self.cem, name)) >= 1:
                raise ValueError(f"cem.{name} of a primitive must be 1 or more, got {value}")
        smallest = min(self.cem.population, self.cem.critic_only_population)
        if not 0 < self.cem.elites <= smallest:
            raise ValueError(
                f"cem.elites of a primitive are 1 to {smallest}, the smallest population, got "
                f"{self.cem.elites}"
            )

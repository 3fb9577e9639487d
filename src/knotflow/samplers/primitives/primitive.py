"""A topological motion primitive: its networks, and cross-entropy search with its critic
(Sec. V-A, Fig. 4 and 5).

Trunk: each of the three streams has an LSTM that reads its points from head to tail. For each
ordered pair of streams an attention module (scaled dot products, [17]) lets every point of one
stream query the points of the other. Each stream's MLP turns a point's LSTM state and its two
look-ups into features, which are pooled over the stream; the three pooled vectors make the rope's
feature. That the MLPs come after the attention is our reading.

Actor and critic each have a trunk of their own, which runs once a rope. Beyond the paper, a scored
spline also attends to the rope near its path (`SplineRopeAttention`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, logsigmoid, scaled_dot_product_attention, softplus

from knotflow.samplers.primitives.config import NetworkConfig, PrimitiveConfig
from knotflow.samplers.primitives.distribution import (
    NODES,
    SPLINE,
    Gaussian,
    NodeGaussian,
    SplineDistribution,
)
from knotflow.samplers.primitives.encoding import (
    CHANNELS,
    CONTROL_FEATURES,
    GRASP_POSITION,
    STREAM_POINTS,
    Encoded,
    control_features,
)
from knotflow.simulation import spline_basis
from knotflow.topology.polyline import Floats

if TYPE_CHECKING:
    from tensordict import TensorDict

States = Mapping[str, Tensor]
"""Encoded ropes, see `Encoded.inputs`."""


class PairAttention(nn.Module):
    """Every point of one stream looks up points of another."""

    def __init__(self, hidden: int, size: int) -> None:
        super().__init__()
        self.query = nn.Linear(hidden, size)
        self.key_value = nn.Linear(hidden, 2 * size)

    def forward(self, asking: Tensor, answering: Tensor) -> Tensor:
        """(S, P, hidden) and (S, Q, hidden) -> (S, P, size)."""
        key, value = self.key_value(answering).chunk(2, dim=-1)
        return scaled_dot_product_attention(self.query(asking), key, value)


class Trunk(nn.Module):
    """Streams (S, P, CHANNELS) -> feature (S, feature), and the points of the whole rope's stream
    with their features (S, Q, `point_features`)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        streams = range(len(STREAM_POINTS))
        self.lstms = nn.ModuleList(
            nn.LSTM(CHANNELS, config.lstm, batch_first=True) for _ in streams
        )
        self.attentions = nn.ModuleDict(
            {
                f"{asking}_{answering}": PairAttention(config.lstm, config.attention)
                for asking in streams
                for answering in streams
                if asking != answering
            }
        )
        self.point_features = CHANNELS + config.lstm + (len(STREAM_POINTS) - 1) * config.attention
        # The second layer of each MLP comes after pooling, where it costs next to nothing.
        self.mlps = nn.ModuleList(
            nn.Sequential(nn.Linear(self.point_features, config.stream), nn.SiLU()) for _ in streams
        )
        self.out = nn.Sequential(
            nn.Linear(2 * len(STREAM_POINTS) * config.stream, config.feature), nn.SiLU()
        )

    def forward(self, streams: Tensor) -> tuple[Tensor, Tensor]:
        points = torch.split(streams, list(STREAM_POINTS), dim=1)
        read = [lstm(part)[0] for lstm, part in zip(self.lstms, points, strict=True)]
        pooled = []
        for asking, mlp in enumerate(self.mlps):
            looked_up = [
                self.attentions[f"{asking}_{answering}"](read[asking], read[answering])
                for answering in range(len(read))
                if answering != asking
            ]
            of_points = torch.cat([points[asking], read[asking], *looked_up], dim=-1)
            features = mlp(of_points)
            pooled += [features.mean(dim=1), features.amax(dim=1)]
        return self.out(torch.cat(pooled, dim=-1)), of_points


class SplineRopeAttention(nn.Module):
    """Attention of points along a spline to the points of the whole rope, which decays with the
    squared distance on the table at a learned rate for each look-up."""

    def __init__(self, config: NetworkConfig, point_features: int) -> None:
        super().__init__()
        self.lookups = config.lookups
        key = 8
        self.of_points = nn.Linear(point_features, config.lookups * key + config.lookup)
        self.query = nn.Linear(_SITE, config.lookups * key)
        self.log_rate = nn.Parameter(torch.linspace(0, 3, config.lookups))
        self.at_place = nn.Sequential(
            nn.Linear(_SITE + config.lookups * config.lookup, config.stream), nn.SiLU()
        )
        self.out = nn.Linear(config.sites * config.stream, config.head)
        t = torch.linspace(0, 1, config.sites)
        weights = torch.from_numpy(spline_basis(t.numpy())).float()
        self.register_buffer("_weights", weights, persistent=False)  # (sites, 3)
        self.register_buffer("_t", t[:, None], persistent=False)

    _weights: Tensor
    _t: Tensor

    def forward(self, of_points: Tensor, streams: Tensor, controls: Tensor) -> Tensor:
        """Splines (S, n, 12) as `control_features` makes them, n on each rope -> (S, n, head)."""
        x = torch.stack([controls[..., 7], controls[..., 1], controls[..., 4]], dim=-1)
        y = torch.stack([controls[..., 8], controls[..., 2], controls[..., 5]], dim=-1)
        path = self._weights @ torch.stack([x, y], dim=-1)  # (S, n, sites, 2)
        height = controls[..., None, 3:4].expand(*path.shape[:-1], 1)
        site = torch.cat([path, height, self._t.expand(*path.shape[:-1], 1)], dim=-1)
        size = self.query.out_features
        by_lookup = (self.lookups, -1)
        query = torch.unflatten(self.query(site).flatten(1, 2), -1, by_lookup).transpose(1, 2)
        key = torch.unflatten(of_points[..., :size], -1, by_lookup).transpose(1, 2)
        # Of the squared distance |p - q|^2 = |p|^2 - 2 p q + |q|^2 a softmax over q needs the last
        # two terms only: products of what is appended to queries (S, lookups, n sites, ...) and
        # keys (S, lookups, Q, ...).
        rate = self.log_rate.exp()[:, None, None]
        p = path[..., :2].flatten(1, 2)[:, None]
        q = streams[:, None, -STREAM_POINTS[-1] :, :2].expand(-1, self.lookups, -1, -1)
        falls = (-rate).expand(*query.shape[:-1], 1)
        query = torch.cat([query / key.shape[-1] ** 0.5, 2 * rate * p, falls], dim=-1)
        key = torch.cat([key, q, q.square().sum(-1, keepdim=True)], dim=-1)
        value = of_points[:, None, :, size:].expand(-1, self.lookups, -1, -1)
        brought = (query @ key.mT).softmax(-1) @ value
        brought = torch.unflatten(brought.transpose(1, 2), 1, site.shape[1:3]).flatten(3)
        passed: Tensor = self.out(self.at_place(torch.cat([site, brought], dim=-1)).flatten(2))
        return passed


_SITE = 4  # x, y, height and position along the spline


class Actor(nn.Module):
    """The distribution over splines in network space (Fig. 4): one Gaussian, or one a node."""

    _rows: Tensor
    _columns: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.trunk = Trunk(config)
        self.of_nodes = config.actor == "nodes"
        entries = SPLINE * (SPLINE + 1) // 2
        read = config.feature + config.kinds + (self.trunk.point_features if self.of_nodes else 0)
        self.head = nn.Sequential(
            nn.Linear(read, config.head),
            nn.SiLU(),
            nn.Linear(config.head, 2 * SPLINE - 1 if self.of_nodes else SPLINE + entries),
        )
        self.kinds = config.kinds
        self.smallest_spread = config.smallest_spread
        rows, columns = torch.tril_indices(SPLINE, SPLINE)
        self.register_buffer("_rows", rows, persistent=False)
        self.register_buffer("_columns", columns, persistent=False)
        last = self.head[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(0.1)
            last.bias.zero_()
            deviations = SPLINE + torch.nonzero(rows == columns)[:, 0]
            if self.of_nodes:
                deviations = torch.arange(SPLINE, 2 * SPLINE - 1)
            spread = torch.tensor(config.initial_spread - config.smallest_spread)
            last.bias[deviations] = torch.log(torch.expm1(spread))

    def forward(self, states: States) -> SplineDistribution:
        feature, points = self.trunk(states["streams"])
        feature = _with_kind(feature, states, self.kinds)
        if self.of_nodes:
            nodes = interpolate(points.mT, NODES, mode="linear", align_corners=True).mT
            out = self.head(torch.cat([nodes, feature[:, None].expand(-1, NODES, -1)], dim=-1))
            share, mean, deviation = out.split([1, SPLINE - 1, SPLINE - 1], dim=-1)
            deviation = softplus(deviation) + self.smallest_spread
            log_share = share[..., 0].log_softmax(-1)
            return NodeGaussian(log_share, mean, deviation, states["grasp"])
        out = self.head(feature)
        mean, entries = out[:, :SPLINE], out[:, SPLINE:]
        diagonal = self._rows == self._columns
        entries = torch.where(diagonal, softplus(entries) + self.smallest_spread, entries)
        factor = out.new_zeros(len(out), SPLINE, SPLINE)
        factor[:, self._rows, self._columns] = entries
        return Gaussian(mean, factor)


class Critic(nn.Module):
    """Two logits of a spline: of success, and, given success, of the next state's value.

    Q is the first of a single-step task, the product where others follow (Sec. V-B c).
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.trunk = Trunk(config)
        # The first layer of the head, cut in two: the rope's part is worked out once a rope.
        self.of_rope = nn.Linear(config.feature + config.kinds, config.head)
        self.kinds = config.kinds
        self.reads_position_only = config.critic_grasp == "position"
        self.of_spline = nn.Sequential(
            nn.Linear(CONTROL_FEATURES, config.head), nn.SiLU(), nn.Linear(config.head, config.head)
        )
        self.passage = SplineRopeAttention(config, self.trunk.point_features)
        self.head = nn.Sequential(
            nn.SiLU(), nn.Linear(config.head, config.head), nn.SiLU(), nn.Linear(config.head, 2)
        )

    def features(self, states: States) -> tuple[Tensor, Tensor]:
        """All that scoring needs of each rope: (S, head), and its points' (S, Q, ...)."""
        feature, points = self.trunk(states["streams"])
        of_rope = self.of_rope(_with_kind(feature, states, self.kinds))
        return of_rope, self.passage.of_points(points)

    def score(self, features: tuple[Tensor, Tensor], states: States, splines: Tensor) -> Tensor:
        """Logits (S, n, 2), success and next value, of splines (S, n, 6), n on each rope."""
        of_rope, of_points = features
        controls = control_features(states, splines)
        if self.reads_position_only:
            controls = controls * controls.new_tensor(GRASP_POSITION)
        passed = self.passage(of_points, states["streams"], controls)
        logits: Tensor = self.head(of_rope[:, None] + self.of_spline(controls) + passed)
        return logits

    def forward(self, states: TensorDict, splines: Tensor, owner: Tensor) -> Tensor:
        """Logits (N, 2) of splines (N, 6) in network space on ropes `owner` (N,) of `states`."""
        of_rope, of_points = self.features(states)
        features = of_rope[owner], of_points[owner]
        return self.score(features, states[owner], splines[:, None])[:, 0]


def _with_kind(feature: Tensor, states: States, kinds: int) -> Tensor:
    """The rope's feature (S, F), with the kind of action where a primitive serves several."""
    return torch.cat([feature, states["kind"]], dim=-1) if kinds else feature


LEAST_SPREAD = 1e-3
"""Added to the deviations of elites, normalised units."""
Score = Callable[[Tensor], Tensor]
"""Values (R, P) of splines (R, P, 6) of R searches; higher is better."""


def cross_entropy(
    score: Score,
    first: SplineDistribution,
    noise: Tensor,
    elites: int,
    full_covariance: bool = False,
    returns: str = "mean",
) -> tuple[Tensor, Tensor]:
    """Run R searches by the cross-entropy method at once (Fig. 5, Sec. VII-B1).

    Args:
        score: values of splines.
        first: what the first splines of each search are drawn from.
        noise: (iterations, R, P, 6) standard normal numbers, all the randomness there is.
        elites: number of best splines kept, at most P.
        full_covariance: whether later Gaussians have the elites' covariance, or its diagonal.
        returns: the "mean" of the last elites, or the "best" of them.

    Returns:
        A spline of each search (R, 6), and its value (R,).
    """
    if not elites <= noise.shape[2]:
        raise ValueError(f"a search keeps {elites} elites of a population of {noise.shape[2]}")
    for numbers in noise:
        splines = first.draw(numbers)  # (R, P, 6)
        values, order = score(splines).topk(elites, dim=1)
        kept = splines.gather(1, order[..., None].expand(-1, -1, SPLINE))  # best first
        mean = kept.mean(dim=1)
        if len(kept):  # of no rope PyTorch warns that there are no degrees of freedom
            factor = torch.diag_embed(kept.std(dim=1, correction=0) + LEAST_SPREAD)
            if full_covariance:
                offsets = kept - mean[:, None]
                least = LEAST_SPREAD**2 * torch.eye(SPLINE)
                factor = torch.linalg.cholesky(offsets.mT @ offsets / elites + least)
            first = Gaussian(mean, factor)
    return (kept[:, 0], values[:, 0]) if returns == "best" else (mean, score(mean[:, None])[:, 0])


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
        first: SplineDistribution | None = None,
        iterations: int | None = None,
        population: int | None = None,
    ) -> Tensor:
        """Splines (S, count, 6) in network space.

        With a critic each is found by a search of its own from `first`, by default `distribution`.
        """
        cem, ropes = self.config.cem, len(encoded.frames)
        first = first or self.distribution(encoded.inputs)
        if self.critic is None:
            return first.draw(standard_normal(rng, (ropes, count, SPLINE)))
        iterations = self._num_iterations if iterations is None else iterations
        if population is None:
            population = cem.critic_only_population if self.actor is None else cem.population
        found, _ = cross_entropy(
            self.scorer(encoded.inputs, use_next_value),
            first.repeat(count),
            standard_normal(rng, (iterations, ropes * count, population, SPLINE)),
            cem.elites,
            cem.full_covariance,
            cem.returns,
        )
        return found.reshape(ropes, count, SPLINE)

    @torch.no_grad()
    def values(self, states: States, noise: Tensor, use_next_value: bool = False) -> Tensor:
        """Max Q (S,), 0..1, over splines, of encoded ropes [S] (Sec. V-B c), from `value_noise`.

        Raises:
            ValueError: there is no critic.
        """
        elites = min(self.config.cem.elites, self.config.cem.valued)
        score, first = self.scorer(states, use_next_value), self.distribution(states)
        return cross_entropy(score, first, noise, elites, returns="best")[1].exp()

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
        values: Floats = self.scorer(encoded.inputs)(network).exp().double().numpy()
        return values

    def distribution(self, states: States) -> SplineDistribution:
        """The actor's, or a wide Gaussian where there is no actor."""
        if self.actor is not None:
            found: SplineDistribution = self.actor(states)
            return found
        ropes = len(states["grasp"])
        factor = self.config.cem.wide_spread * torch.eye(SPLINE).expand(ropes, SPLINE, SPLINE)
        return Gaussian(torch.zeros(ropes, SPLINE), factor)

    def scorer(self, states: States, use_next_value: bool = False) -> Score:
        """Log Q (R, P) of splines (R, P, 6), of as many searches on each rope.

        Q is the probability of success, times the next state's value if `use_next_value`.

        Raises:
            ValueError: there is no critic.
        """
        critic = self.critic
        if critic is None:
            raise ValueError(f"a primitive of variant {self.config.variant} has no critic")
        features = critic.features(states)

        def score(splines: Tensor) -> Tensor:
            logits = critic.score(
                features, states, splines.reshape(len(states["grasp"]), -1, SPLINE)
            )
            value = logsigmoid(logits[..., 0])
            if use_next_value:
                value = value + logsigmoid(logits[..., 1])
            return value.reshape(splines.shape[:2])

        return score

"""The networks of a topological motion primitive (Sec. V-A, Fig. 4).

Trunk: each of the three streams has an LSTM that reads its points from head to tail. For each
ordered pair of streams an attention module (scaled dot products, [17]) lets every point of one
stream, the query, look up points of the other, the values. Each stream's MLP turns a point's LSTM
state and what its two look-ups brought into features, which are pooled over the stream; the three
pooled vectors make the rope's feature. No weights are shared between streams or pairs. The figure
is missing from our copy of the paper: that the MLPs come after the attention is our reading.

Actor and critic each have a trunk of their own, as in the figure. The trunk runs once a rope: the
actor predicts one Gaussian a rope, and the critic's head scores any number of splines on its
feature.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.distributions import MultivariateNormal
from torch.nn.functional import scaled_dot_product_attention, softplus

from knotflow.primitives.encoding import (
    CHANNELS,
    CONTROL_FEATURES,
    STREAM_POINTS,
    control_features,
)

SPLINE = 6


@dataclass
class NetworkConfig:
    """Sizes of actor and critic."""

    lstm: int = 48
    """Hidden size of each stream's LSTM."""
    attention: int = 32
    """Size of queries, keys and values."""
    stream: int = 64
    """Size of each stream's MLP."""
    feature: int = 96
    """Size of the rope's feature."""
    head: int = 128
    """Hidden size of the actor's and the critic's head."""
    smallest_spread: float = 0.05
    """Least standard deviation of the actor along any direction, whitened units."""
    initial_spread: float = 0.5
    """Standard deviation of an untrained actor, whitened units."""


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
    """Streams (S, P, CHANNELS) -> feature (S, feature)."""

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
        seen = CHANNELS + config.lstm + (len(STREAM_POINTS) - 1) * config.attention
        self.mlps = nn.ModuleList(
            nn.Sequential(
                nn.Linear(seen, config.stream), nn.SiLU(), nn.Linear(config.stream, config.stream)
            )
            for _ in streams
        )
        self.out = nn.Sequential(
            nn.Linear(2 * len(STREAM_POINTS) * config.stream, config.feature), nn.SiLU()
        )

    def forward(self, streams: Tensor) -> Tensor:
        points = streams.split(STREAM_POINTS, dim=1)
        read = [lstm(part)[0] for lstm, part in zip(self.lstms, points, strict=True)]
        pooled = []
        for asking, mlp in enumerate(self.mlps):
            looked_up = [
                self.attentions[f"{asking}_{answering}"](read[asking], read[answering])
                for answering in range(len(read))
                if answering != asking
            ]
            features = mlp(torch.cat([points[asking], read[asking], *looked_up], dim=-1))
            pooled += [features.mean(dim=1), features.amax(dim=1)]
        return self.out(torch.cat(pooled, dim=-1))


class Actor(nn.Module):
    """The Gaussian N(mu, Sigma) over splines in network space that Fig. 4 calls the actor."""

    _rows: Tensor
    _columns: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.trunk = Trunk(config)
        self.head = nn.Sequential(
            nn.Linear(config.feature, config.head),
            nn.SiLU(),
            nn.Linear(config.head, SPLINE + SPLINE * (SPLINE + 1) // 2),
        )
        self.smallest_spread = config.smallest_spread
        rows, columns = torch.tril_indices(SPLINE, SPLINE)
        self.register_buffer("_rows", rows, persistent=False)
        self.register_buffer("_columns", columns, persistent=False)
        last = self.head[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(0.1)
            last.bias.zero_()
            diagonal = SPLINE + torch.nonzero(rows == columns)[:, 0]
            spread = torch.tensor(config.initial_spread - config.smallest_spread)
            last.bias[diagonal] = torch.log(torch.expm1(spread))

    def forward(self, states: TensorDict) -> tuple[Tensor, Tensor]:
        """Mean (S, 6) and lower Cholesky factor (S, 6, 6) of the covariance."""
        out = self.head(self.trunk(states["streams"]))
        mean, entries = out[:, :SPLINE], out[:, SPLINE:]
        diagonal = self._rows == self._columns
        entries = torch.where(diagonal, softplus(entries) + self.smallest_spread, entries)
        factor = out.new_zeros(len(out), SPLINE, SPLINE)
        factor[:, self._rows, self._columns] = entries
        return mean, factor

    def distribution(self, states: TensorDict) -> MultivariateNormal:
        """The predicted distribution, a batch of S."""
        mean, factor = self(states)
        return MultivariateNormal(mean, scale_tril=factor, validate_args=False)


class Critic(nn.Module):
    """Probability that a spline accomplishes the action, as a logit: Q of a single-step task."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.trunk = Trunk(config)
        # The first layer of the head, cut in two: the rope's part is worked out once a rope.
        self.of_rope = nn.Linear(config.feature, config.head)
        self.of_spline = nn.Sequential(
            nn.Linear(CONTROL_FEATURES, config.head), nn.SiLU(), nn.Linear(config.head, config.head)
        )
        self.head = nn.Sequential(
            nn.SiLU(), nn.Linear(config.head, config.head), nn.SiLU(), nn.Linear(config.head, 1)
        )

    def features(self, states: TensorDict) -> Tensor:
        """(S, head): all that scoring needs of each rope."""
        return self.of_rope(self.trunk(states["streams"]))

    def score(self, features: Tensor, states: TensorDict, splines: Tensor, owner: Tensor) -> Tensor:
        """Logits (N,) of splines (N, 6), each on the rope `owner` (N,) among S."""
        spline = self.of_spline(control_features(states, splines, owner))
        return self.head(features[owner] + spline).squeeze(-1)

    def forward(self, states: TensorDict, splines: Tensor, owner: Tensor) -> Tensor:
        """Logits (N,) of splines (N, 6) in network space on the ropes `owner` (N,) of `states`."""
        return self.score(self.features(states), states, splines, owner)

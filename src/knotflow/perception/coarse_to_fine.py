"""A rope's vertices from its patch, coarse to fine (Sec. VI, after [15]).

A convolutional encoder sees the whole patch and places a few nodes along the rope. Each level then
has more nodes, looks up the image's features where they are, lets them attend to each other along
the rope, and moves them. [15] is unpublished; what is known of it is this outline.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import grid_sample, interpolate

from knotflow.perception.training_config import CoarseToFineConfig


class Nodes(NamedTuple):
    """Nodes of one level: `places` (N, K, 3), in the patch (-1..1) and height (radii), and
    `log_scale` (N, K), the logarithm of their typical distance to the truth in half patches."""

    places: Tensor
    log_scale: Tensor


class CoarseToFine(nn.Module):
    """Patches (N, 3, S, S) to the nodes of each level, coarse first, from either end."""

    def __init__(self, config: CoarseToFineConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or CoarseToFineConfig()
        self.encoder = nn.ModuleList()
        before = 3
        for level, channels in enumerate(config.channels):
            self.encoder.append(_halving(before, channels, residuals=min(level, 2)))
            before = channels
        side = config.size // 2 ** len(config.channels)
        squeezed, self._coarse = config.channels[-1] // 4, config.nodes[0]
        self.coarse = nn.Sequential(
            nn.Conv2d(before, squeezed, 1),
            nn.Flatten(),
            nn.ReLU(),
            nn.Linear(squeezed * side**2, 3 * config.width),
            nn.ReLU(),
            nn.Linear(3 * config.width, self._coarse * (3 + config.width)),
        )
        self.levels = nn.ModuleList(
            _Level(count, sum(config.channels), config.width, config.layers)
            for count in config.nodes
        )

    def forward(self, patches: Tensor) -> list[Nodes]:
        maps, features = [], patches
        for stage in self.encoder:
            features = stage(features)
            maps.append(features)
        first = self.coarse(features).unflatten(1, (self._coarse, -1))
        places, hidden = first[..., :3], first[..., 3:]
        places = torch.cat([places[..., :2], 1 + places[..., 2:]], dim=-1)  # on the table
        found = [Nodes(places, places.new_zeros(places.shape[:2]))]
        for level in self.levels:
            nodes, hidden = level(maps, found[-1].places, hidden)
            found.append(nodes)
        return found


class _Level(nn.Module):
    def __init__(self, count: int, channels: int, width: int, layers: int) -> None:
        super().__init__()
        self.count = count
        self.order = nn.Parameter(0.1 * torch.randn(count, width))
        self.features = nn.Linear(channels, width)
        self.where = nn.Linear(9, width)
        layer = nn.TransformerEncoderLayer(
            width, 4, 2 * width, dropout=0.0, batch_first=True, norm_first=True
        )
        self.attention = nn.TransformerEncoder(layer, layers, enable_nested_tensor=False)
        self.change = nn.Linear(width, 4)
        nn.init.zeros_(self.change.weight)
        nn.init.zeros_(self.change.bias)

    def forward(self, maps: list[Tensor], places: Tensor, hidden: Tensor) -> tuple[Nodes, Tensor]:
        places, hidden = resampled(places, self.count), resampled(hidden, self.count)
        look = places[:, :, None, :2]  # (N, K, 1, 2)
        seen = torch.cat(
            [grid_sample(one, look, align_corners=False)[..., 0] for one in maps], dim=1
        ).transpose(1, 2)
        back = places - places.roll(1, dims=1)
        onward = places.roll(-1, dims=1) - places
        where = torch.cat([places, back, onward], dim=-1)
        hidden = hidden + self.order + self.features(seen) + self.where(where)
        hidden = self.attention(hidden)
        change = self.change(hidden)
        return Nodes(places + change[..., :3], change[..., 3] - 2.0), hidden


def resampled(values: Tensor, count: int) -> Tensor:
    """Values (N, K, C) along a rope at `count` evenly spaced places, linearly in between."""
    if values.shape[1] == count:
        return values
    along = interpolate(values.transpose(1, 2), count, mode="linear", align_corners=True)
    return along.transpose(1, 2)


def _halving(before: int, channels: int, residuals: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, channels, 4, stride=2, padding=1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
        *(Residual(channels) for _ in range(residuals)),
    )


class Residual(nn.Module):
    """A convolution (N, C, H, W) beside the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
            nn.ReLU(),
        )

    def forward(self, features: Tensor) -> Tensor:
        return features + self.body(features)

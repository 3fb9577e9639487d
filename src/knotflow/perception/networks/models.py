"""The two networks: a rope's vertices from its patch, and the next step along a strand (Sec. VI).

`CoarseToFine` follows what is known of [15], which is unpublished: each level has more nodes,
samples the encoder's features where they are, lets them attend to each other, and moves them.
`StrandNetwork` sees a window at the end of a strand, as HANDLOOM (Shivakumar et al., CoRL 2023).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import grid_sample, interpolate

SIDE = 48
"""Pixels of a window's side."""
HALF = 12.0
"""Half its side, radii of the rope."""
STEP = 2.0
"""Length of a step along a strand, radii."""
TRAIL = 12
"""Steps back that the window shows."""
HEADINGS = 32
"""Directions of a step that are distinguished,"""
WIDEST = 1.6
"""up to this angle to either side, radians."""


@dataclass
class CoarseToFineConfig:
    """Sizes of the network."""

    size: int = 96
    """Pixels of the patch's side."""
    channels: tuple[int, ...] = (16, 32, 64, 96)
    """Features of the encoder, each at half the resolution of the one before."""
    nodes: tuple[int, ...] = (9, 17, 41)
    """Nodes of each level."""
    width: int = 64
    """Features of a node."""
    layers: int = 2
    """Attention layers of each level."""


@dataclass
class StrandNetworkConfig:
    """Sizes of the network that follows strands."""

    channels: tuple[int, ...] = (16, 32, 64)
    """Features of the encoder, each at half the resolution of the one before."""
    width: int = 96
    """Features of what is predicted from them."""


class Nodes(NamedTuple):
    """Nodes of one level: `places` (N, K, 3), in the patch (-1..1) and height (radii), and
    `log_scale` (N, K), the logarithm of their typical distance to the truth in half patches."""

    places: Tensor
    log_scale: Tensor


class NextStep(NamedTuple):
    """How strands go on: `heading` (N, HEADINGS) logarithms of probabilities, `height` (N,) of the
    axis after the step, radii, and `end` (N,), the logit of there being none."""

    heading: Tensor
    height: Tensor
    end: Tensor


class CoarseToFine(nn.Module):
    """Patches (N, 3, S, S) to the nodes of each level, coarse first, from either end."""

    def __init__(self, config: CoarseToFineConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or CoarseToFineConfig()
        self.encoder = nn.ModuleList()
        before = 3
        for level, channels in enumerate(config.channels):
            residuals = (Residual(channels) for _ in range(min(level, 2)))
            self.encoder.append(nn.Sequential(*_halving(before, channels), *residuals))
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
        places = resample_nodes(places, self.count)
        hidden = resample_nodes(hidden, self.count)
        grid = places[:, :, None, :2]  # (N, K, 1, 2)
        sampled = [grid_sample(one, grid, align_corners=False)[..., 0] for one in maps]
        features = torch.cat(sampled, dim=1).transpose(1, 2)
        back = places - places.roll(1, dims=1)
        onward = places.roll(-1, dims=1) - places
        where = torch.cat([places, back, onward], dim=-1)
        hidden = hidden + self.order + self.features(features) + self.where(where)
        hidden = self.attention(hidden)
        change = self.change(hidden)
        return Nodes(places + change[..., :3], change[..., 3] - 2.0), hidden


def resample_nodes(values: Tensor, count: int) -> Tensor:
    """Values (N, K, C) along a rope at `count` evenly spaced places, linearly in between."""
    if values.shape[1] == count:
        return values
    along = interpolate(values.transpose(1, 2), count, mode="linear", align_corners=True)
    return along.transpose(1, 2)


class StrandNetwork(nn.Module):
    """Windows (N, 5, SIDE, SIDE) and the strand's height there (N,), radii, to its next step.

    A window's channels are those of `Patch.crop`, and the trail's share and height; its first axis
    is the strand's direction.
    """

    def __init__(self, config: StrandNetworkConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or StrandNetworkConfig()
        stages: list[nn.Module] = []
        before = 5
        for number, count in enumerate(config.channels):
            stages += [*_halving(before, count), *([Residual(count)] if number else [])]
            before = count
        self.seen = nn.Sequential(*stages, nn.Flatten())
        side = SIDE // 2 ** len(config.channels)
        self.body = nn.Sequential(
            nn.Linear(before * side**2 + 1, config.width),
            nn.ReLU(),
            nn.Linear(config.width, config.width),
            nn.ReLU(),
        )
        self.heads = nn.Linear(config.width, HEADINGS + 2)

    def forward(self, windows: Tensor, height: Tensor) -> NextStep:
        found = self.heads(self.body(torch.cat([self.seen(windows), height[:, None]], dim=1)))
        heading = found[:, :HEADINGS].log_softmax(dim=1)
        return NextStep(heading, height + found[:, HEADINGS], found[:, HEADINGS + 1])


def headings() -> Tensor:
    """The middle (HEADINGS,) of each direction, radians."""
    return (torch.arange(HEADINGS) + 0.5) * (2 * WIDEST / HEADINGS) - WIDEST


def _halving(before: int, channels: int) -> list[nn.Module]:
    return [
        nn.Conv2d(before, channels, 4, stride=2, padding=1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
    ]


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

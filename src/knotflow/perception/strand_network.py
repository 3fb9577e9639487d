"""Which way a strand goes on, from a small window around where it has been followed to (Sec. VI).

Where a whole rope is hard to read at one glance, a tight knot above all, how a strand goes on from
here is not: HANDLOOM (Shivakumar et al., CoRL 2023) follows real cables so, crop by crop. The
window is turned along the strand and shows, beside what the camera sees, the strand as it was
followed so far. What the network predicts is a distribution: where strands meet it may have two
modes, and both are followed, see `strand_tracing`.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from knotflow.perception.coarse_to_fine import Residual
from knotflow.perception.training_config import StrandNetworkConfig

SIDE = 48
"""Pixels of a window's side."""
HALF = 12.0
"""Half its side, radii of the rope: a pixel is half a radius."""
STEP = 2.0
"""How far a strand is followed at once, radii."""
TRAIL = 12
"""Steps back that the window shows."""
HEADINGS = 32
"""Directions of a step that are distinguished,"""
WIDEST = 1.6
"""up to this angle to either side, radians."""


class Onward(NamedTuple):
    """How strands go on: `heading` (N, HEADINGS) logarithms of probabilities, `height` (N,) of the
    axis after the step, radii, and `end` (N,), the logit of there being none."""

    heading: Tensor
    height: Tensor
    end: Tensor


class StrandNetwork(nn.Module):
    """Windows (N, 5, SIDE, SIDE) and the strand's height there (N,), radii, to how it goes on.

    A window's channels are those of `Patch.crop` and those of `rasterise` for the trail; its first
    axis is the strand's direction.
    """

    def __init__(self, config: StrandNetworkConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or StrandNetworkConfig()
        stages: list[nn.Module] = []
        before = 5
        for number, count in enumerate(config.channels):
            stages += [
                nn.Conv2d(before, count, 4, stride=2, padding=1, bias=False),
                nn.BatchNorm2d(count),
                nn.ReLU(),
            ]
            if number:
                stages.append(Residual(count))
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

    def forward(self, windows: Tensor, height: Tensor) -> Onward:
        found = self.heads(self.body(torch.cat([self.seen(windows), height[:, None]], dim=1)))
        heading = found[:, :HEADINGS].log_softmax(dim=1)
        return Onward(heading, height + found[:, HEADINGS], found[:, HEADINGS + 1])


def headings() -> Tensor:
    """The middle (HEADINGS,) of each direction, radians."""
    return (torch.arange(HEADINGS) + 0.5) * (2 * WIDEST / HEADINGS) - WIDEST

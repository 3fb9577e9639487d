"""The network that proposes how a rope runs through its image: it follows strands (Sec. VI).

It stands in for the paper's state estimation network [15], which is unpublished. It sees a window
at the end of a strand, as HANDLOOM (Shivakumar et al., CoRL 2023).
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn

from knotflow.arrays import read_weights, save_weights
from knotflow.perception import SHIPPED_NETWORK
from knotflow.perception.networks.windows import HEADINGS, SIDE

FORMAT, VERSION = "knotflow strand network", "1"
"""Of a file; the version is raised when older weights would mean something else."""


class NetworkError(ValueError):
    """A file that is no strand network, or not one that can be used here."""


@dataclass
class StrandNetworkConfig:
    """Sizes of the network that follows strands."""

    channels: tuple[int, ...] = (16, 32, 64)  # of the encoder, each at half the resolution
    width: int = 96  # features of what is predicted from them


class NextStep(NamedTuple):
    """How strands go on: `heading` (N, HEADINGS) logarithms of probabilities, `height` (N,) of the
    axis after the step, radii, and `end` (N,), the logit of there being none."""

    heading: Tensor
    height: Tensor
    end: Tensor


def convolution(before: int, channels: int, size: int, stride: int = 1) -> list[nn.Module]:
    """Of images (N, C, H, W), normalised; a stride of 2 halves the resolution."""
    layer = nn.Conv2d(before, channels, size, stride, padding=1, bias=False)
    return [layer, nn.BatchNorm2d(channels), nn.ReLU()]


class Residual(nn.Module):
    """A convolution (N, C, H, W) beside the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.body = nn.Sequential(*convolution(channels, channels, 3))

    def forward(self, features: Tensor) -> Tensor:
        return features + self.body(features)


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
            stages += [*convolution(before, count, 4, 2), *([Residual(count)] if number else [])]
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

    def save(self, path: Path | str, half: bool = True) -> None:
        """Write weights (by default in half precision) and sizes to one safetensors file."""
        about = {"format": FORMAT, "version": VERSION, "network": json.dumps(asdict(self.config))}
        save_weights(path, dict(self.state_dict()), about, half)

    @classmethod
    def load(cls, path: Path | str = SHIPPED_NETWORK) -> StrandNetwork:
        """The network of a file that `save` wrote.

        Raises:
            NetworkError: naming the file, and what is wrong with it.
        """
        try:
            about, weights = read_weights(path)
        except ValueError as error:
            raise NetworkError(
                f"{error}; python -m knotflow +experiment=strand_training trains one"
            ) from error
        if about.get("format") != FORMAT or about.get("version") != VERSION:
            raise NetworkError(
                f"{path}: is {about.get('format', 'of no known format')}, version "
                f"{about.get('version', 'unknown')}; {FORMAT}, version {VERSION} is needed"
            )
        sizes = json.loads(about["network"])
        network = cls(StrandNetworkConfig(tuple(sizes["channels"]), sizes["width"]))
        try:
            network.load_state_dict(weights)
        except RuntimeError as error:
            raise NetworkError(f"{path}: weights do not fit: {error}") from error
        return network


@cache
def shipped_network() -> StrandNetwork:
    """The network that the package ships."""
    return StrandNetwork.load()

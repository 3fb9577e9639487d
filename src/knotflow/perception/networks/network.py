"""State estimation networks: first guesses at a rope from one RGB-D image (Sec. VI, [15]).

`CoarseToFine` follows what is known of [15], which is unpublished: each level has more nodes,
samples the encoder's features where they are, lets them attend to each other, and moves them.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import grid_sample, interpolate

from knotflow.arrays import save_weights
from knotflow.perception import SHIPPED_NETWORK
from knotflow.perception.camera.rendering import render
from knotflow.perception.estimation.evidence import Target
from knotflow.perception.estimation.fitting import project_lengths
from knotflow.perception.networks.patches import crop_rope
from knotflow.perception.networks.strands import (
    Residual,
    StrandNetwork,
    StrandNetworkConfig,
    halving,
    trace_rope,
)
from knotflow.simulation import resample
from knotflow.threads import one_thread

FORMAT, VERSION = "knotflow state estimation", "1"
"""Of a file; the version is raised when older weights would mean something else."""
_FLIPS = ((1, 1), (-1, 1), (1, -1), (-1, -1))  # signs of a patch's axes in its mirror images
_PATHS = 12  # along the strands that are guesses, most
_SOFTNESS = 4e-3  # of the rendering by which guesses are compared, metres
_STRANDS = "strands."  # begins the names of the second network's weights


@dataclass
class CoarseToFineConfig:
    """Sizes of the network."""

    size: int = 96  # pixels of the patch's side
    channels: tuple[int, ...] = (16, 32, 64, 96)  # of the encoder, each at half the resolution
    nodes: tuple[int, ...] = (9, 17, 41)  # nodes of each level
    width: int = 64  # features of a node
    layers: int = 2  # attention layers of each level


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
            residuals = (Residual(channels) for _ in range(min(level, 2)))
            self.encoder.append(nn.Sequential(*halving(before, channels), *residuals))
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


class NetworkError(ValueError):
    """A file that is no state estimation network, or not one that can be used here."""


class Network:
    """Trained networks that propose ropes for images: the `model` sees a whole rope, and `strands`,
    if there are, follows strands."""

    def __init__(self, model: CoarseToFine, strands: StrandNetwork | None = None) -> None:
        self.model, self.strands = model, strands

    @one_thread()
    @torch.inference_mode()
    def guesses(self, target: Target) -> list[NDArray[np.float64]]:
        """First guesses (V, 3), metres, at the rope of an image, from either end: one from each
        mirror image of its patch, and the likeliest along its strands. The one that covers
        the rope best comes first.

        Raises:
            TraceError: there is no rope in the image.
        """
        camera, rope = target.camera, target.rope
        patch, crop = crop_rope(target, self.model.config.size)
        self.model.eval()
        mirrored = np.stack([crop[:, ::across, ::along] for along, across in _FLIPS])
        nodes = self.model(torch.from_numpy(mirrored))[-1]
        found: list[NDArray[np.float64]] = []
        for flip, places in zip(_FLIPS, nodes.places.double().numpy(), strict=True):
            shape = patch.to_world(places * [*flip, 1], camera)
            found.append(resample(project_lengths(shape, rope.length / (len(shape) - 1)), rope))
        if self.strands is not None:
            found += trace_rope(self.strands, target)[:_PATHS]

        share, known = target.coverage.numpy(), target.known.numpy()

        def missed(guess: NDArray) -> float:
            """Mean difference from where rope is seen, over known pixels."""
            _, occupancy = render(torch.as_tensor(guess), rope.radius, camera, _SOFTNESS)
            return float(np.abs(occupancy.numpy() - share)[known].mean())

        return sorted(found, key=missed)

    def save(self, path: Path | str, half: bool = True) -> None:
        """Write weights (by default in half precision) and sizes to one safetensors file."""
        about = {"format": FORMAT, "version": VERSION}
        about["network"] = json.dumps(asdict(self.model.config))
        weights = dict(self.model.state_dict())
        if self.strands is not None:
            about["strands"] = json.dumps(asdict(self.strands.config))
            weights |= {_STRANDS + name: one for name, one in self.strands.state_dict().items()}
        save_weights(path, weights, about, half)

    @classmethod
    def load(cls, path: Path | str = SHIPPED_NETWORK) -> Network:
        """The network of a file that `save` wrote.

        Raises:
            NetworkError: naming the file, and what is wrong with it.
        """
        from safetensors import SafetensorError, safe_open

        try:
            with safe_open(path, "pt") as file:
                about = file.metadata() or {}
                weights = {name: file.get_tensor(name) for name in file.keys()}
        except (OSError, SafetensorError) as error:
            raise NetworkError(
                f"{path}: no network can be read ({error}); "
                "python -m knotflow +experiment=perception_training trains one"
            ) from error
        if about.get("format") != FORMAT or about.get("version") != VERSION:
            raise NetworkError(
                f"{path}: is {about.get('format', 'of no known format')}, version "
                f"{about.get('version', 'unknown')}; {FORMAT}, version {VERSION} is needed"
            )
        model = CoarseToFine(CoarseToFineConfig(**_sizes(about["network"])))
        strands = None
        if "strands" in about:
            strands = StrandNetwork(StrandNetworkConfig(**_sizes(about["strands"])))
        whole = {name: one for name, one in weights.items() if not name.startswith(_STRANDS)}
        others = {name.removeprefix(_STRANDS): weights[name] for name in weights.keys() - whole}
        try:
            model.load_state_dict(whole)
            if strands is not None:
                strands.load_state_dict(others)
        except RuntimeError as error:
            raise NetworkError(f"{path}: weights do not fit: {error}") from error
        return cls(model, strands)


def _sizes(text: str) -> dict[str, Any]:
    """A network's sizes as they were saved."""
    sizes: dict[str, Any] = json.loads(text)
    return {name: tuple(one) if isinstance(one, list) else one for name, one in sizes.items()}


@cache
def shipped_network() -> Network:
    """The network that the package ships."""
    return Network.load()

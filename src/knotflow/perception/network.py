"""State estimation networks: first guesses at a rope from one RGB-D image (Sec. VI, [15]).

One network sees the rope's patch of the table in each of its four mirror images, so that its guess
turns and mirrors with the rope. Another follows strands from window to window. Of all their guesses
the one counts first that accounts best for where rope is seen. The fit does the rest:
`estimate(image, camera, rope, initial=points)`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera import Camera
from knotflow.perception.coarse_to_fine import CoarseToFine
from knotflow.perception.fitting import project_lengths
from knotflow.perception.image import RgbdImage
from knotflow.perception.patch import Patch, seen_places
from knotflow.perception.rendering import render
from knotflow.perception.segmentation import Segmentation
from knotflow.perception.strand_network import StrandNetwork
from knotflow.perception.strand_tracing import trace_rope
from knotflow.perception.tracing import TraceError
from knotflow.perception.training_config import (
    SHIPPED_NETWORK,
    CoarseToFineConfig,
    StrandNetworkConfig,
)
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig, resample
from knotflow.threads import one_thread

FORMAT = "knotflow state estimation"
VERSION = "1"
"""Raised when patch, window or networks change, so that older weights mean something else."""
_STRANDS = "strands."  # begins the names of the second network's weights
FLIPS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
"""The patch's mirror images: signs of its first and second axis."""
PATHS = 12
"""Paths along the strands that are guesses, most."""
SOFTNESS = 4e-3
"""Softness of the rendering by which guesses are compared, metres."""

Floats = NDArray[np.float64]


class NetworkError(ValueError):
    """A file that is no state estimation network, or not one that can be used here."""


class Network:
    """Trained networks; they propose ropes for images, on one thread of PyTorch.

    Attributes:
        model: sees a whole rope.
        strands: follows strands; None where only whole ropes are seen.
    """

    def __init__(self, model: CoarseToFine, strands: StrandNetwork | None = None) -> None:
        self.model, self.strands = model, strands

    @one_thread()
    @torch.no_grad()
    def propose(
        self, image: RgbdImage, camera: Camera, rope: RopeConfig, segmentation: Segmentation
    ) -> tuple[Floats, Floats]:
        """A first guess at the rope of an image, the likeliest of `guesses`.

        Returns:
            points (V, 3): metres, from either end.
            confidence (V,): probability that a vertex is no further off than the rope is thick,
                0..1.

        Raises:
            TraceError: there is no rope in the segmentation.
        """
        return self.guesses(image, camera, rope, segmentation)[0]

    @torch.inference_mode()
    def guesses(
        self, image: RgbdImage, camera: Camera, rope: RopeConfig, segmentation: Segmentation
    ) -> list[tuple[Floats, Floats]]:
        """First guesses at the rope of an image, one from each mirror image of its patch, and the
        `PATHS` likeliest along its strands; the one that covers the segmentation best comes first.

        Args:
            image: of this camera.
            camera: any that sees the rope from above.
            rope: its length, radius and number of links.
            segmentation: of this image.

        Returns:
            points (V, 3) and confidence (V,) of each, as `propose` has them.

        Raises:
            TraceError: there is no rope in the segmentation.
        """
        share = coverage(image, segmentation)
        patch, crop = look(segmentation, share, camera, rope, self.model.config.size)
        self.model.eval()
        nodes = self.model(torch.stack(list(mirrored(torch.as_tensor(crop)))))[-1]
        found: list[tuple[Floats, Floats]] = []
        for flip, places, log_scale in zip(FLIPS, *nodes, strict=True):
            shape = patch.flipped(*flip).to_world(places.double().numpy(), camera)
            shape = project_lengths(shape, rope.length / (len(shape) - 1))
            scale = patch.half * np.exp(log_scale.double().numpy())
            confidence = np.interp(
                np.linspace(0, 1, rope.num_vertices),
                np.linspace(0, 1, len(shape)),
                1.0 - np.exp(-2 * rope.radius / scale),
            )
            found.append((resample(shape, rope), confidence))
        if self.strands is not None:
            found += trace_rope(self.strands, segmentation, share, camera, rope)[:PATHS]

        def missed(guess: tuple[Floats, Floats]) -> float:
            return _missed(guess[0], share, segmentation, camera, rope)

        return sorted(found, key=missed)

    def save(self, path: Path | str, half: bool = True) -> None:
        """Write weights (by default in half precision) and sizes to one safetensors file."""
        from safetensors.torch import save_file

        about = {"format": FORMAT, "version": VERSION}
        about["network"] = json.dumps(asdict(self.model.config))
        weights = dict(self.model.state_dict())
        if self.strands is not None:
            about["strands"] = json.dumps(asdict(self.strands.config))
            weights |= {_STRANDS + name: one for name, one in self.strands.state_dict().items()}
        weights = {
            name: (one.half() if half and one.is_floating_point() else one).contiguous()
            for name, one in weights.items()
        }
        save_file(weights, path, about)

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
                weights = {name: _float(file.get_tensor(name)) for name in file.keys()}
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


def _float(weights: Tensor) -> Tensor:
    return weights.float() if weights.is_floating_point() else weights


def _sizes(text: str) -> dict[str, Any]:
    """A network's sizes as they were saved."""
    sizes: dict[str, Any] = json.loads(text)
    return {name: tuple(one) if isinstance(one, list) else one for name, one in sizes.items()}


@cache
def shipped_network() -> Network | None:
    """The network that the package ships; None where it ships none."""
    return network_of(SHIPPED_NETWORK)


def network_of(file: Path) -> Network | None:
    """The network in a file; None where there is no such file.

    Raises:
        NetworkError: see `Network.load`.
    """
    return Network.load(file) if file.is_file() else None


def look(
    segmentation: Segmentation, share: NDArray, camera: Camera, rope: RopeConfig, size: int
) -> tuple[Patch, NDArray[np.float32]]:
    """The rope's patch, and what is seen of it (3, size, size), see `Patch.crop`.

    Raises:
        TraceError: there is no rope in the segmentation.
    """
    places = seen_places(segmentation.rope, camera, rope.radius)
    if len(places) < 2:
        raise TraceError("no rope is seen, so none can be proposed")
    patch = Patch.around(places, rope.radius, rope.length)
    return patch, patch.crop(segmentation, share, camera, size)


def mirrored(crop: Tensor) -> Iterable[Tensor]:
    """The crop (3, S, S) in each of `FLIPS`."""
    for along, across in FLIPS:
        axes = [axis for axis, sign in ((2, along), (1, across)) if sign < 0]
        yield crop.flip(axes) if axes else crop


def _missed(
    shape: Floats, share: NDArray, segmentation: Segmentation, camera: Camera, rope: RopeConfig
) -> float:
    """Mean difference between where a shape (V, 3) is seen and where rope is, over known pixels."""
    _, occupancy = render(torch.as_tensor(shape), rope.radius, camera, SOFTNESS)
    known = ~(segmentation.unknown | segmentation.gripper)
    return float(np.abs(occupancy.numpy() - share)[known].mean())

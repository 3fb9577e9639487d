"""State estimation networks: first guesses at a rope from one RGB-D image (Sec. VI, [15])."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.perception import SHIPPED_NETWORK
from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.rendering import render
from knotflow.perception.estimation.chain import project_lengths
from knotflow.perception.estimation.segmentation import Segmentation, pixel_coverage
from knotflow.perception.networks.models import (
    CoarseToFine,
    CoarseToFineConfig,
    StrandNetwork,
    StrandNetworkConfig,
)
from knotflow.perception.networks.patches import FLIPS, crop_rope, mirrored
from knotflow.perception.networks.strand_tracing import trace_rope
from knotflow.simulation import RopeConfig, resample
from knotflow.threads import one_thread

FORMAT, VERSION = "knotflow state estimation", "1"
"""Of a file; the version is raised when older weights would mean something else."""
PATHS = 12
"""Paths along the strands that are guesses, most."""
SOFTNESS = 4e-3
"""Softness of the rendering by which guesses are compared, metres."""
_STRANDS = "strands."  # begins the names of the second network's weights


class NetworkError(ValueError):
    """A file that is no state estimation network, or not one that can be used here."""


class Network:
    """Trained networks that propose ropes for images.

    Attributes:
        model: sees a whole rope.
        strands: follows strands; None where only whole ropes are seen.
    """

    def __init__(self, model: CoarseToFine, strands: StrandNetwork | None = None) -> None:
        self.model, self.strands = model, strands

    @one_thread()
    @torch.inference_mode()
    def guesses(
        self, image: RgbdImage, camera: Camera, rope: RopeConfig, segmentation: Segmentation
    ) -> list[NDArray[np.float64]]:
        """First guesses (V, 3), metres, at the rope of an image, from either end: one from each
        mirror image of its patch, and the `PATHS` likeliest along its strands. The one that covers
        the segmentation best comes first.

        Raises:
            TraceError: there is no rope in the segmentation.
        """
        share = pixel_coverage(image, segmentation)
        patch, crop = crop_rope(segmentation, share, camera, rope, self.model.config.size)
        self.model.eval()
        nodes = self.model(torch.stack(list(mirrored(torch.as_tensor(crop)))))[-1]
        found: list[NDArray[np.float64]] = []
        for flip, places in zip(FLIPS, nodes.places, strict=True):
            shape = patch.flipped(*flip).to_world(places.double().numpy(), camera)
            found.append(resample(project_lengths(shape, rope.length / (len(shape) - 1)), rope))
        if self.strands is not None:
            found += trace_rope(self.strands, segmentation, share, camera, rope)[:PATHS]

        def missed(guess: NDArray) -> float:
            """Mean difference from where rope is seen, over known pixels."""
            _, occupancy = render(torch.as_tensor(guess), rope.radius, camera, SOFTNESS)
            return float(np.abs(occupancy.numpy() - share)[segmentation.known].mean())

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
def shipped_network() -> Network | None:
    """The network that the package ships; None where it ships none."""
    return load_if_present(SHIPPED_NETWORK)


def load_if_present(file: Path) -> Network | None:
    """The network in a file; None where there is no such file.

    Raises:
        NetworkError: see `Network.load`.
    """
    return Network.load(file) if file.is_file() else None

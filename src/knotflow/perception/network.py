"""The state estimation network: a first guess at a rope from one RGB-D image (Sec. VI, [15]).

The network sees the rope's patch of the table in each of its four mirror images, so that its guess
turns and mirrors with the rope, and of the four guesses the one is taken that accounts best for
where rope is seen. The fit does the rest: `estimate(image, camera, rope, initial=points)`.
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
from knotflow.perception.tracing import TraceError
from knotflow.perception.training_config import SHIPPED_NETWORK, CoarseToFineConfig
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig, resample
from knotflow.threads import one_thread

FORMAT = "knotflow state estimation"
VERSION = "1"
"""Raised when the patch or the network change, so that older weights mean something else."""
FLIPS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
"""The patch's mirror images: signs of its first and second axis."""
SOFTNESS = 4e-3
"""Softness of the rendering by which guesses are compared, metres."""

Floats = NDArray[np.float64]


class NetworkError(ValueError):
    """A file that is no state estimation network, or not one that can be used here."""


class Network:
    """A trained network; proposes ropes for images. It computes on one thread of PyTorch."""

    def __init__(self, model: CoarseToFine) -> None:
        self.model = model

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
        """First guesses at the rope of an image, one from each mirror image of its patch; the one
        that covers the segmentation best comes first.

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
        mirrored = torch.stack(list(_mirrored(torch.as_tensor(crop))))
        nodes = self.model(mirrored)[-1]
        found: list[tuple[float, Floats, Floats]] = []
        for flip, places, log_scale in zip(FLIPS, *nodes, strict=True):
            shape = patch.flipped(*flip).to_world(places.double().numpy(), camera)
            shape = project_lengths(shape, rope.length / (len(shape) - 1))
            scale = patch.half * np.exp(log_scale.double().numpy())
            confidence = np.interp(
                np.linspace(0, 1, rope.num_vertices),
                np.linspace(0, 1, len(shape)),
                1.0 - np.exp(-2 * rope.radius / scale),
            )
            missed = _missed(shape, share, segmentation, camera, rope)
            found.append((missed, resample(shape, rope), confidence))
        return [one[1:] for one in sorted(found, key=lambda one: one[0])]

    def save(self, path: Path | str, half: bool = True) -> None:
        """Write weights (by default in half precision) and sizes to one safetensors file."""
        from safetensors.torch import save_file

        weights = {
            name: (one.half() if half and one.is_floating_point() else one).contiguous()
            for name, one in self.model.state_dict().items()
        }
        sizes = json.dumps(asdict(self.model.config))
        save_file(weights, path, {"format": FORMAT, "version": VERSION, "network": sizes})

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
                weights: dict[str, Tensor] = {name: file.get_tensor(name) for name in file.keys()}
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
        sizes: dict[str, Any] = json.loads(about["network"])
        lists = {name: tuple(one) for name, one in sizes.items() if isinstance(one, list)}
        model = CoarseToFine(CoarseToFineConfig(**(sizes | lists)))
        try:
            model.load_state_dict(
                {n: one.float() if one.is_floating_point() else one for n, one in weights.items()}
            )
        except RuntimeError as error:
            raise NetworkError(f"{path}: weights do not fit: {error}") from error
        return cls(model)


@cache
def shipped_network() -> Network | None:
    """The network that the package ships; None where it ships none."""
    return Network.load() if SHIPPED_NETWORK.exists() else None


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


def _mirrored(crop: Tensor) -> Iterable[Tensor]:
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

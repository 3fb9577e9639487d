"""The estimation of a rope and its ablations, as the perception experiment compares them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.estimation import (
    EstimateConfig,
    RopeEstimate,
    estimate,
    propose,
    propose_points,
)
from knotflow.perception.fitting import FitConfig
from knotflow.perception.image import RgbdImage
from knotflow.perception.network import Network
from knotflow.simulation import RopeConfig, resample

POOR = 0.03
"""How far off a poor start is, metres, root mean square."""
SUPERVISED, SELF_SUPERVISED = "supervised", "self_supervised"
"""Networks: as trained on simulated ropes, and after learning from images alone besides. They
differ in how they see a whole rope; strands are followed by the same network in both."""

MARKED, PLAIN, FINE = "marked", "plain", "fine"
"""Images of a rope: its head coloured, not coloured, and coloured with twice as many pixels along
each side."""


@dataclass(frozen=True)
class EstimationMethod:
    """Where an estimate starts, and what it does then."""

    tracing: bool = False
    """Start from the paths through the mask's skeleton."""
    network: str | None = None
    """Start from the guess of `SUPERVISED` or `SELF_SUPERVISED`; with both starts, the fit that
    accounts best for the image counts; with neither, from the true shape moved by `POOR`."""
    strands: bool = True
    """Whether the network's guesses come from following strands, too."""
    rendering: bool = True
    """Fit by gradient steps on the rendering; otherwise the start is the estimate."""
    depth: bool = True
    """Let these steps see depth."""
    view: str = MARKED
    """Which image it sees: `MARKED`, `FINE`, or `PLAIN`, where the head is found by an earlier
    shape, off by `POOR`."""
    nominal: bool = False
    """Compared at nominal noise only."""

    def estimate(
        self,
        image: RgbdImage,
        camera: Camera,
        rope: RopeConfig,
        config: EstimateConfig,
        networks: Mapping[str, Network],
        truth: NDArray,
        rng: np.random.Generator,
    ) -> RopeEstimate:
        """The rope in an image.

        Args:
            image: of this camera.
            camera: its intrinsics and pose.
            rope: its length, radius and number of links.
            config: how.
            networks: by name, the one that is started from among them.
            truth: (V, 3) metres, the true shape, for poor starts and earlier shapes only.
            rng: of these.

        Raises:
            TraceError: there is no rope in the image.
        """
        network = None if self.network is None else networks[self.network]
        if network is not None and not self.strands:
            network = Network(network.model)
        if not self.depth:
            config = replace(config, fit=replace(config.fit or FitConfig(), depth=0.0))
        if self.tracing:
            config = replace(config, propose=network is not None)
            earlier = _moved(truth, rope, rng) if self.view == PLAIN else None
            return estimate(image, camera, rope, None, config, earlier, network)
        if network is None:
            return estimate(image, camera, rope, _moved(truth, rope, rng), config)
        if not self.rendering:
            return propose(image, camera, rope, network, config)
        return estimate(image, camera, rope, propose_points(image, camera, rope, network), config)


METHODS = {
    "rendering": EstimationMethod(tracing=True, nominal=True),
    "rendering_without_depth": EstimationMethod(tracing=True, depth=False, nominal=True),
    "rendering_poor_start": EstimationMethod(nominal=True),
    "network": EstimationMethod(network=SELF_SUPERVISED, rendering=False),
    "network_without_strands": EstimationMethod(
        network=SELF_SUPERVISED, strands=False, rendering=False, nominal=True
    ),
    "network_without_strands_self_supervision": EstimationMethod(
        network=SUPERVISED, strands=False, rendering=False, nominal=True
    ),
    "network_rendering": EstimationMethod(network=SELF_SUPERVISED),
    "network_rendering_without_strands": EstimationMethod(
        network=SELF_SUPERVISED, strands=False, nominal=True
    ),
    "network_rendering_without_strands_self_supervision": EstimationMethod(
        network=SUPERVISED, strands=False, nominal=True
    ),
    "network_rendering_without_depth": EstimationMethod(
        network=SELF_SUPERVISED, depth=False, nominal=True
    ),
    "network_tracing_rendering": EstimationMethod(tracing=True, network=SELF_SUPERVISED),
    "network_tracing_rendering_without_strands": EstimationMethod(
        tracing=True, network=SELF_SUPERVISED, strands=False, nominal=True
    ),
    "network_tracing_rendering_plain_rope": EstimationMethod(
        tracing=True, network=SELF_SUPERVISED, view=PLAIN, nominal=True
    ),
    "network_tracing_rendering_fine": EstimationMethod(
        tracing=True, network=SELF_SUPERVISED, view=FINE
    ),
}
"""What the experiment compares, by name."""


def _moved(truth: NDArray, rope: RopeConfig, rng: np.random.Generator) -> NDArray[np.float64]:
    """A shape (V, 3) moved by `POOR`, smoothly along the rope."""
    waves = np.sin(np.pi * np.outer(np.linspace(0, 1, len(truth)), np.arange(1, 5)))  # (V, 4)
    off = waves @ rng.normal(size=(4, 2)) + rng.normal(size=2)
    off *= POOR / np.sqrt((off**2).sum(axis=1).mean())
    return resample(truth + np.pad(off, ((0, 0), (0, 1))), rope)

"""Methods of estimation that the perception experiment compares, on which ropes, and by what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import Label, RgbdImage, add_noise
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.simulated import SimulatedCamera
from knotflow.perception.estimation.estimate import EstimateConfig, RopeEstimate, estimate, propose
from knotflow.perception.estimation.evidence import observe
from knotflow.perception.estimation.fitting import nearest_on_chain
from knotflow.perception.estimation.segmentation import segment
from knotflow.perception.networks.network import Network
from knotflow.seeding import rng_of
from knotflow.simulation import RopeConfig, check_points, resample, state_or_none

POOR = 0.03
"""Root mean square error of a poor start, metres."""
SUPERVISED, SELF_SUPERVISED = "supervised", "self_supervised"
"""Networks: as trained on simulated ropes, and after learning from images alone besides; both have
the same network that follows strands."""
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
    """Its image: `MARKED`, `FINE`, or `PLAIN`, where an earlier shape, off by `POOR`, tells the
    head."""
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
        """The rope in an image of a camera, with networks by name; the `truth` (V, 3), metres, is
        for poor starts and earlier shapes, which `rng` draws.

        Raises:
            TraceError: there is no rope in the image.
        """
        network = None if self.network is None else networks[self.network]
        if network is not None and not self.strands:
            network = Network(network.model)
        if not self.depth:
            config = replace(config, fit=replace(config.fit, depth=0.0))
        if self.tracing:
            config = replace(config, propose=network is not None)
            earlier = _moved(truth, rope, rng) if self.view == PLAIN else None
            return estimate(image, camera, rope, None, config, earlier, network)
        if network is None:
            return estimate(image, camera, rope, _moved(truth, rope, rng), config)
        if not self.rendering:
            return propose(image, camera, rope, network, config)
        guess = network.guesses(observe(image, camera, rope))[0]
        return estimate(image, camera, rope, guess, config)


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


def choose_ropes(
    path: Path, crossings: Sequence[int], count: int, rope: RopeConfig, seed: int
) -> dict[tuple[int, int], NDArray]:
    """At most `count` shapes (V, 3), metres, in view, of each number of crossings, by that and a
    count, drawn from the file of the stage `ropes`.

    Raises:
        ValueError: no rope of a number of crossings.
    """
    with np.load(path) as file:
        points, of_each = file["points"].astype(np.float64), file["crossings"]
    rng = rng_of(seed, 0)
    camera = Camera.overhead()
    chosen: dict[tuple[int, int], NDArray] = {}
    for number in crossings:
        rows = [row for row in np.flatnonzero(of_each == number) if _in_view(points[row], camera)]
        if not rows:
            raise ValueError(
                f"{path} has no rope of {number} crossings in the camera's view: raise "
                "perception.shards"
            )
        if len(rows) < count:
            print(f"only {len(rows)} ropes of {number} crossings are in view", flush=True)
        for place, row in enumerate(rng.permutation(rows)[:count]):
            chosen[number, place] = check_points(resample(points[row], rope), rope)
    return chosen


def _in_view(points: NDArray, camera: Camera) -> bool:
    """Whether the whole rope is seen, with some pixels to spare."""
    pixels = camera.project(points)[:, :2]
    return bool(pixels.min() > 4 and (pixels < [camera.width - 5, camera.height - 5]).all())


def noisy_image(
    camera: SimulatedCamera, truth: NDArray, rng: np.random.Generator
) -> tuple[RgbdImage, float]:
    """An image with noise, and the intersection over union of its rope, as it is segmented, with
    the pixels that show rope."""
    view = camera.view(truth)
    image = add_noise(view.image, camera.camera, camera.noise, rng)
    found = segment(image, camera.camera, camera.rope.radius).rope
    there = view.labels == Label.ROPE
    return image, float((found & there).sum() / (found | there).sum())


def metrics(found: RopeEstimate | None, truth: NDArray) -> dict[str, Any]:
    """How far an estimate is from the true rope (V, 3); empty where no rope was found."""
    if found is None:
        empty = dict.fromkeys(("mean_error_mm", "p95_error_mm", "off_curve_error_mm"), np.nan)
        return empty | dict.fromkeys(("state_correct", "head_correct"), 0) | {"doubtful": 1}
    error = 1e3 * np.linalg.norm(found.points - truth, axis=1)
    reversed_error = 1e3 * np.linalg.norm(found.points[::-1] - truth, axis=1)
    off = np.linalg.norm(nearest_on_chain(found.points, truth)[2], axis=1)
    return {
        "mean_error_mm": round(float(error.mean()), 3),
        "p95_error_mm": round(float(np.quantile(error, 0.95)), 3),
        "off_curve_error_mm": round(float(1e3 * off.mean()), 3),
        "state_correct": int(found.state == state_or_none(truth)),
        "head_correct": int(error.mean() < reversed_error.mean()),
        "doubtful": int(found.ambiguous),
    }

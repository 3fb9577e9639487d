"""Stage `perception_networks`: the network that sees ropes, before and after self-supervision.

A lab with a rope of its own has images, but no shapes: on such images the trained network goes on
learning. Here ropes are simulated, and their shapes serve to take the images only.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.perception import (
    Appearance,
    Camera,
    CameraNoiseConfig,
    Network,
    RgbdImage,
    SelfSupervision,
    SelfSupervisionConfig,
    SimulatedCamera,
)
from knotflow.perception.methods import SELF_SUPERVISED, SUPERVISED
from knotflow.perception.training_config import SHIPPED_NETWORK
from knotflow.simulation import RopeConfig, resample
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.ropes import FILE as ROPES


@dataclass(kw_only=True)
class PerceptionNetworksConfig:
    """Which network, and the images that it learns from."""

    network: str = runtime("")
    """File of the weights; what counts is `network_contents`."""
    network_contents: str
    """Hash of the file, or its name where there is none."""
    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope in the images."""
    noise: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    """Of the camera."""
    images: int
    """Images, each of another rope."""
    learning: SelfSupervisionConfig = field(default_factory=SelfSupervisionConfig)
    """The effort."""
    seed: int
    """Of the choice of ropes, of light, noise and batches; used for nothing else."""


@stage("perception_networks", inputs=("ropes",))
def adapt_networks(
    config: PerceptionNetworksConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes supervised.safetensors, self_supervised.safetensors and losses.csv, a row a step.

    Makes nothing, and says so, while the package ships no weights and none are given.

    Raises:
        NetworkError: the file given is not a network that can be used.
    """
    if Path(config.network) == SHIPPED_NETWORK and not SHIPPED_NETWORK.exists():
        print(
            "no network is shipped yet, so methods that need one are not run; "
            "python -m knotflow +experiment=perception_training trains one, and "
            "perception.network=results/perception_training/network.safetensors takes it"
        )
        return
    network = Network.load(config.network)
    with context.atomic(weights_file(SUPERVISED)) as path:
        shutil.copyfile(config.network, path)
    learning = SelfSupervision(
        network,
        _images(config, inputs["ropes"] / ROPES),
        Camera.overhead(),
        config.rope,
        config.learning,
        config.seed,
    )
    steps = context.progress(learning, total=config.learning.steps, desc="self-supervision")
    losses = pd.DataFrame({"loss": list(steps)})
    with context.atomic("losses.csv") as path:
        losses.to_csv(path, index_label="step", float_format="%.6g")
    with context.atomic(weights_file(SELF_SUPERVISED)) as path:
        network.save(path)


def weights_file(network: str) -> str:
    """The name of the file in which the stage leaves a network."""
    return f"{network}.safetensors"


def load_networks(folder: Path) -> dict[str, Network]:
    """The networks that the stage left in a folder, by name; none where there were no weights."""
    paths = {name: folder / weights_file(name) for name in (SUPERVISED, SELF_SUPERVISED)}
    return {name: Network.load(path) for name, path in paths.items() if path.exists()}


def _images(config: PerceptionNetworksConfig, path: Path) -> list[RgbdImage]:
    """Images of ropes drawn from a file, all numbers of crossings equally often."""
    with np.load(path) as file:
        points, crossings = file["points"].astype(np.float64), file["crossings"]
    rng = np.random.default_rng(config.seed)
    share = 1 / np.bincount(crossings)[crossings]
    rows = rng.choice(
        len(points), min(config.images, len(points)), replace=False, p=share / share.sum()
    )
    images = []
    for row in rows:
        eye = SimulatedCamera(
            Camera.overhead(), config.rope, config.noise, Appearance.draw(rng, config.noise)
        )
        images.append(eye.capture(resample(points[row], config.rope), rng))
    return images

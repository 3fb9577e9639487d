"""Stage `perception_networks`: the network that sees ropes, before and after self-supervision.

A lab with a rope of its own has images, but no shapes: the trained network goes on learning from
what is estimated in such images without a doubt. Here ropes are simulated, and their shapes serve
to take the images only.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.perception import (
    Appearance,
    Camera,
    CameraNoiseConfig,
    EstimateConfig,
    Network,
    RgbdImage,
    SelfSupervision,
    SelfSupervisionConfig,
    SimulatedCamera,
    TraceError,
    estimate,
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
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    """How the ropes in them are estimated."""
    learning: SelfSupervisionConfig = field(default_factory=SelfSupervisionConfig)
    """The effort."""
    seed: int
    """Of the choice of ropes, of light, noise and batches; used for nothing else."""


@stage("perception_networks", version=2, inputs=("ropes",))
def adapt_networks(
    config: PerceptionNetworksConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes supervised.safetensors, self_supervised.safetensors, losses.csv, a row a step, and
    shapes/NUMBER.npy, the estimate of each image: (V, 3), or (0, 3) where it is in doubt.

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
    ropes = _ropes(config, inputs["ropes"] / ROPES)
    names = [f"shapes/{number}" for number in range(len(ropes))]
    context.each(partial(_estimate, config, ropes), context.pending(names, ".npy"), "estimates")
    shapes = [np.load(context.out / f"{name}.npy") for name in names]
    sure = [number for number, shape in enumerate(shapes) if len(shape)]
    print(f"{len(sure)} of {len(ropes)} images leave nothing in doubt", flush=True)
    losses: list[float] = []
    if sure:
        learning = SelfSupervision(
            network,
            [_image(config, ropes[number], number) for number in sure],
            [shapes[number] for number in sure],
            Camera.overhead(),
            config.rope,
            config.learning,
            config.seed,
        )
        losses += context.progress(learning, total=config.learning.steps, desc="self-supervision")
    with context.atomic("losses.csv") as path:
        pd.DataFrame({"loss": losses}).to_csv(path, index_label="step", float_format="%.6g")
    with context.atomic(weights_file(SELF_SUPERVISED)) as path:
        network.save(path)


def weights_file(network: str) -> str:
    """The name of the file in which the stage leaves a network."""
    return f"{network}.safetensors"


def load_networks(folder: Path) -> dict[str, Network]:
    """The networks that the stage left in a folder, by name; none where there were no weights."""
    paths = {name: folder / weights_file(name) for name in (SUPERVISED, SELF_SUPERVISED)}
    return {name: Network.load(path) for name, path in paths.items() if path.exists()}


def _ropes(config: PerceptionNetworksConfig, path: Path) -> list[NDArray[np.float64]]:
    """Ropes (V, 3) drawn from a file, all numbers of crossings equally often."""
    with np.load(path) as file:
        points, crossings = file["points"].astype(np.float64), file["crossings"]
    rng = np.random.default_rng(config.seed)
    share = 1 / np.bincount(crossings)[crossings]
    count = min(config.images, len(points))
    rows = rng.choice(len(points), count, replace=False, p=share / share.sum())
    return [resample(points[row], config.rope) for row in rows]


def _image(config: PerceptionNetworksConfig, rope: NDArray, number: int) -> RgbdImage:
    """The image of a rope (V, 3), which has a light and noise of its own."""
    rng = np.random.default_rng([config.seed, number])
    appearance = Appearance.draw(rng, config.noise)
    eye = SimulatedCamera(Camera.overhead(), config.rope, config.noise, appearance)
    return eye.capture(rope, rng)


def _estimate(
    config: PerceptionNetworksConfig, ropes: list[NDArray], context: StageContext, name: str
) -> None:
    """Keeps what the image of a rope says of it."""
    number = int(Path(name).name)
    image, network = _image(config, ropes[number], number), Network.load(config.network)
    try:
        found = estimate(
            image, Camera.overhead(), config.rope, config=config.estimate, network=network
        )
    except TraceError:
        found = None
    shape = np.empty((0, 3)) if found is None or found.doubtful else found.points
    with context.atomic(f"{name}.npy") as path, open(path, "wb") as file:
        np.save(file, shape)  # given a path, it would append an ending

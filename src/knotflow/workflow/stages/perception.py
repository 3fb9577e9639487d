"""Stage `perception`: ropes at rest, estimated from one image, by noise and crossings."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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
    NetworkError,
    SimulatedCamera,
    TraceError,
)
from knotflow.perception.measures import choose_ropes, measures, noisy_image
from knotflow.perception.methods import FINE, MARKED, METHODS, PLAIN
from knotflow.perception.seeing import DrawnEstimate, draw_estimates
from knotflow.simulation import RopeConfig, SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.perception_networks import load_networks

TABLE = "estimates.csv"
NOMINAL = 1.0
"""Level of noise of the images that are drawn, and at which all methods are compared."""
CAMERAS = {MARKED: Camera.overhead(), PLAIN: Camera.overhead(), FINE: Camera.overhead(640, 480)}
"""What takes a method's view of a rope."""
SHOWN = ("network_tracing_rendering", "rendering")
"""The first of these that is run is drawn."""


@dataclass(kw_only=True)
class PerceptionConfig:
    """Which ropes are looked at, and by which methods."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """Its rope is looked at."""
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    """How a rope is estimated."""
    noise: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    """Of the camera; its level is set here."""
    methods: list[str] = field(default_factory=lambda: list(METHODS))
    """Of `METHODS`; those that need a network are left out while there are no weights."""
    levels: list[float]
    """Of noise; some methods are compared at 1 only."""
    crossings: list[int]
    """Numbers of crossings that ropes have."""
    ropes: int
    """Ropes of each number of crossings; each is seen at every level."""
    seed: int
    """Of the choice of ropes, of light and noise; used for nothing else."""


@stage("perception", inputs=("ropes", "networks"))
def estimate_ropes(
    config: PerceptionConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes estimates.csv, a row a method, level and rope.

    Raises:
        ValueError: an unknown method, or no rope of a number of crossings.
        NetworkError: all methods need a network, and there is none.
    """
    unknown = sorted(set(config.methods) - set(METHODS))
    if unknown:
        raise ValueError(f"unknown methods {unknown}; methods are: {', '.join(METHODS)}")
    config = replace(config, methods=_that_can_run(config.methods, inputs["networks"]))
    rope, path = config.simulation.rope, inputs["ropes"] / "ropes.npz"
    chosen = choose_ropes(path, config.crossings, config.ropes, rope, config.seed)
    names = [f"{crossings}-{number}" for crossings, number in chosen]
    ropes = dict(zip(names, chosen.values(), strict=True))
    work = partial(_estimate_rope, config, ropes, inputs["networks"])
    context.table(TABLE, work, names, "perception")
    _draw(context, config.simulation.rope)


def _that_can_run(methods: list[str], networks: Path) -> list[str]:
    """Those methods whose network is there."""
    there = load_networks(networks)
    run = [name for name in methods if METHODS[name].network in (None, *there)]
    if not run:
        raise NetworkError(
            f"methods {', '.join(methods)} need a network, and there are no weights: "
            "python -m knotflow +experiment=perception_training trains one, perception.network= "
            "takes its file"
        )
    if left_out := [name for name in methods if name not in run]:
        print(f"not run, as there is no network: {', '.join(left_out)}", flush=True)
    return run


def _estimate_rope(
    config: PerceptionConfig,
    ropes: Mapping[str, NDArray],
    weights: Path,
    context: StageContext,
    name: str,
) -> pd.DataFrame:
    truth, rope = ropes[name], config.simulation.rope
    networks = load_networks(weights)
    crossings, number = map(int, name.split("-"))
    rows = []
    for level in config.levels:
        rng = np.random.default_rng([config.seed, 1, crossings, number, round(100 * level)])
        noise = replace(config.noise, level=level)
        appearance = Appearance.draw(rng, noise)
        methods = [name for name in config.methods if level == NOMINAL or not METHODS[name].nominal]
        looks = {MARKED: appearance, PLAIN: replace(appearance, head=None), FINE: appearance}
        images = {
            view: noisy_image(SimulatedCamera(CAMERAS[view], rope, noise, look), truth, rng)
            for view, look in looks.items()
            if any(METHODS[name].view == view for name in methods)
        }
        for method in methods:
            how = METHODS[method]
            image, rope_iou = images[how.view]
            camera = CAMERAS[how.view]
            began = time.process_time()
            try:
                found = how.estimate(image, camera, rope, config.estimate, networks, truth, rng)
            except TraceError:
                found = None
            seconds = time.process_time() - began
            rows.append(
                {"method": method, "noise": level, "crossings": crossings, "rope": number}
                | measures(found, truth)
                | {"rope_iou": round(rope_iou, 4), "seconds": round(seconds, 3)}
            )
            if found is not None and (method, level, number) == (_shown(config), NOMINAL, 0):
                with context.atomic(f"shown/{crossings}.npz") as path:
                    np.savez(path, rgb=image.rgb, found=found.points, seen=found.seen, truth=truth)
    return pd.DataFrame(rows)


def _shown(config: PerceptionConfig) -> str:
    """The method whose estimates are drawn."""
    return next((method for method in SHOWN if method in config.methods), config.methods[-1])


def _draw(context: StageContext, rope: RopeConfig) -> None:
    """Makes estimates.png and estimates.svg of the estimates that were kept."""
    paths = sorted((context.out / "shown").glob("*.npz"))
    if not paths:
        return
    drawn = []
    for path in paths:
        with np.load(path) as file:
            drawn.append(DrawnEstimate(**file))
    for ending in ("png", "svg"):
        with context.atomic(f"estimates.{ending}") as path:
            draw_estimates(path, drawn, Camera.overhead(), rope)

"""Stage `gradient_steps`: milliseconds of a step that fits a rope's shape to an image."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.perception import SAMPLE, Camera, FitConfig, RgbdImage, fit, observe
from knotflow.simulation import RopeConfig, resample
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass(kw_only=True)
class GradientStepsConfig:
    """What is timed."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope whose shape is fitted."""
    steps: int = 80
    """Steps of each fit."""
    run: int
    """Raise it to time again: a finished stage is never run twice."""


@stage("gradient_steps", inputs=())
def time_steps(
    config: GradientStepsConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes gradient_steps.csv: CPU milliseconds of a step on the shipped overhand's image, by the
    pixels along each side of one of the grid that a step looks at."""
    camera = Camera.load(SAMPLE / "camera.yaml")
    image = RgbdImage.read(SAMPLE / "overhand.png", SAMPLE / "overhand-depth.png", camera)
    points = resample(np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1), config.rope)
    target, once = observe(image, camera, config.rope), FitConfig(steps=1)
    rows = []
    for grid in (1, 2):
        coarse, eye = target.binned(grid), camera.binned(grid)
        fit(points, coarse, eye, config.rope, once)  # caches are warm
        began = time.process_time()
        fit(points, coarse, eye, config.rope, replace(once, steps=config.steps))
        seconds = time.process_time() - began
        rows.append({"grid": grid, "milliseconds": round(1e3 * seconds / config.steps, 2)})
    with context.atomic("gradient_steps.csv") as path:
        pd.DataFrame(rows).to_csv(path, index=False)

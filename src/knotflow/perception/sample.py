"""An image to try things with: a rope with an overhand, seen by the default camera.

`python -m knotflow.perception.sample` reproduces the images from the rope.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from knotflow.perception.appearance import TAPE, Appearance
from knotflow.perception.camera import Camera
from knotflow.perception.noise import CameraNoiseConfig
from knotflow.perception.simulated import SimulatedCamera
from knotflow.simulation import RopeConfig

SAMPLE = Path(__file__).parent / "data"
"""Holds `overhand.png`, `overhand-depth.png`, `camera.yaml` and the true rope, `overhand.csv`."""


def write_sample(folder: Path) -> None:
    """Writes the sample's images and camera file, with nominal noise, into a folder."""
    points = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    camera = Camera.overhead()
    look = replace(Appearance(), head=TAPE)
    simulated = SimulatedCamera(camera, RopeConfig(), CameraNoiseConfig(), look)
    image = simulated.capture(points, np.random.default_rng(0))
    image.write(folder / "overhand.png", folder / "overhand-depth.png")
    camera.save(folder / "camera.yaml")


if __name__ == "__main__":
    write_sample(SAMPLE)

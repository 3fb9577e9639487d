"""What the stand-in for a robot and its camera does wrong, by level."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knotflow.simulation import ACTUATION

if TYPE_CHECKING:
    from knotflow.perception import Camera


@dataclass(frozen=True)
class Errors:
    """What a robot and its camera do wrong."""

    actuation: float
    """Standard deviation of the gripper's place in x and y while it moves, metres."""
    grasp: float
    """The same of the place at which the fingers close, metres."""
    camera_shift: float
    """Largest error of the camera's position along each axis, metres."""
    camera_turn: float
    """Largest error of its orientation about each axis, radians."""
    camera_noise: float
    """`CameraNoiseConfig.level` of its images."""


ERRORS = (
    Errors(ACTUATION[0], ACTUATION[0], 0.0, 0.0, 0.0),
    Errors(ACTUATION[1], ACTUATION[1], 0.002, np.deg2rad(0.2), 1.0),
    Errors(ACTUATION[2], ACTUATION[2], 0.002, np.deg2rad(0.2), 1.0),
)
"""Of each level of `simulation.perturbation`."""


def displaced(camera: Camera, errors: Errors, rng: np.random.Generator) -> Camera:
    """A camera that stands not quite where it is believed to."""
    from scipy.spatial.transform import Rotation

    shift = rng.uniform(-1, 1, 3) * errors.camera_shift
    turn = Rotation.from_rotvec(rng.uniform(-1, 1, 3) * errors.camera_turn).as_matrix()
    return replace(camera, position=camera.position + shift, rotation=turn @ camera.rotation)

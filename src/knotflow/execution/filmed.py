"""Demonstrated splines on ropes that differ from the demonstrated ones, as a camera sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.perturbation import ERRORS, displaced
from knotflow.perception import (
    Appearance,
    Camera,
    CameraNoiseConfig,
    Label,
    RgbdImage,
    SimulatedCamera,
    add_noise,
    seen,
)
from knotflow.samplers.demonstrations import Demonstration
from knotflow.simulation import Attempts, RopeConfig, RopeSimulator, SimulationConfig, attempt


@dataclass(frozen=True, eq=False)
class FilmedRollout:
    """A rollout, and its images: one a frame, and one of the end when the gripper has left.

    Attributes:
        attempts: the one rollout, on a rope that differs.
        images: T + 1 images.
        shows: (T + 1, V) whether an image shows a vertex.
        camera: where it truly stood.
    """

    attempts: Attempts
    images: tuple[RgbdImage, ...]
    shows: NDArray[np.bool_]
    camera: Camera


def film_rollout(
    demonstrations: Sequence[Demonstration],
    rope: RopeConfig,
    level: int,
    simulation: SimulationConfig,
    noise: CameraNoiseConfig,
    rng: np.random.Generator,
) -> FilmedRollout:
    """One of the demonstrations, drawn at random, on another rope.

    Args:
        demonstrations: of one action.
        rope: that is dragged.
        level: how far the camera is from where it is believed to be, see `ERRORS`.
        simulation: of the demonstrated rope; its record rate is the camera's.
        noise: of the camera.
        rng: draws all else.
    """
    attempts = _repeated(demonstrations, rope, simulation, rng)
    rollouts = attempts.rollouts
    camera = displaced(Camera.overhead(), ERRORS[level], rng)
    eye = SimulatedCamera(camera, rope, noise, Appearance.draw(rng, noise))
    after = rollouts.times[-1:] + 1 / simulation.record_rate
    images, shows = [], []
    for seconds, points, gripper in zip(
        np.concatenate([rollouts.times, after]),
        np.concatenate([rollouts.trajectory[0], rollouts.trajectory[0, -1:]]).astype(np.float64),
        [*rollouts.gripper[0], None],
        strict=True,
    ):
        closed = 0 < seconds < simulation.move_time
        view = eye.view(points, gripper, bool(closed), float(seconds))
        images.append(add_noise(view.image, camera, noise, rng))
        shows.append(seen(points, view.labels == Label.ROPE, view.image, camera, rope))
    return FilmedRollout(attempts, tuple(images), np.stack(shows), camera)


def _repeated(
    demonstrations: Sequence[Demonstration],
    rope: RopeConfig,
    simulation: SimulationConfig,
    rng: np.random.Generator,
) -> Attempts:
    """A demonstrated spline on the other rope."""
    simulator = RopeSimulator(replace(simulation, rope=rope))
    while True:
        shown = demonstrations[int(rng.integers(len(demonstrations)))]
        points = shown.points + [0.0, 0.0, rope.radius - simulation.rope.radius]
        task = shown.task
        tried = attempt(simulator, points, shown.spline[None], task.action, task.start_state)
        if not tried.rollouts.diverged.any():
            return tried

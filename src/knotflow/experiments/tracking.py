"""Ropes followed image by image through whole rollouts of all actions (Sec. VI).

The ropes differ from the planner's, and the camera is not quite where it is believed to be, as in
closed loop. Every tracker begins with the true shape.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.execution import (
    LstmDynamics,
    ModelPrediction,
    MujocoDynamics,
    Observation,
    encode_jpeg,
    film_rollout,
)
from knotflow.perception import (
    Camera,
    CameraNoiseConfig,
    StrandNetwork,
    Tracker,
    TrackerConfig,
    estimate,
)
from knotflow.recording import RolloutImages, recorded, write_recording
from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.seeding import rng_of
from knotflow.simulation import SimulationConfig, grasped_link, perturb_rope, state_or_none
from knotflow.workflow import StageRun, stage

TRACKER, AT_REST = "rendering_mujoco", "rendering_mujoco_at_rest"
"""Gradient steps on the rendering from what the planner's simulator predicts; and the tracked rope
estimated once more when it has come to rest and the gripper has left the image."""
MISPLACED = "camera_misplaced"
"""The true rope at rest, moved by how far the camera is from where it is believed to be."""


@stage
def tracking(
    run: StageRun,
    *,
    demonstrations_file: Path,
    dynamics_weights: Path,
    network: Path,
    simulation: SimulationConfig,
    camera_noise: CameraNoiseConfig = CameraNoiseConfig(),
    tracker: TrackerConfig = TrackerConfig(),
    levels: list[int],
    rollouts: int,
    seed: int,
) -> None:
    """Makes tracks.csv (a row a method and frame) and a recording of a rollout with its images.

    The record rate of `simulation` is the camera's; noise is nominal at every level.
    """
    names = [
        f"{level}-{task.name}-{number}"
        for level in levels
        for task in TASKS
        for number in range(rollouts)
    ]
    believed, camera = simulation.rope, Camera.overhead()

    def track(name: str) -> pd.DataFrame:
        """One rollout; the first of all is recorded with its images."""
        level, action, number = name.split("-")
        trained = StrandNetwork.load(network)
        rng = rng_of(seed, int(level), *map(ord, action), int(number))
        rope = perturb_rope(believed, int(level), rng)
        own = [one for one in load_demonstrations(demonstrations_file) if one.task.name == action]
        attempts, (*images, at_rest), true_camera = film_rollout(
            own, rope, int(level), simulation, camera_noise, rng
        )
        moves = attempts.rollouts
        truth, gripper = (one[0].astype(np.float64) for one in (moves.trajectory, moves.gripper))
        held = moves.times < moves.release_times[0] - 1e-6
        held[0] = False
        link = int(grasped_link(attempts.splines[0], rope.links))
        rows: list[dict[str, Any]] = []
        predictions = {
            "rendering_lstm": ModelPrediction(LstmDynamics.load(dynamics_weights)),
            TRACKER: ModelPrediction(MujocoDynamics(replace(simulation, threads=1))),
        }
        for method, prediction in predictions.items():
            follower = Tracker(camera, believed, truth[0], prediction, tracker, trained)
            found = []
            for frame, image in enumerate(images):
                began = time.process_time()
                grasped = link if held[frame] else None
                found.append(follower.update(image, gripper[frame], grasped))
                seconds = time.process_time() - began
                rows.append(_row(method, frame, found[-1], truth[frame], seconds, held[frame]))
            if method == TRACKER:
                began, last = time.process_time(), follower.points
                seen = estimate(
                    at_rest, camera, believed, None, tracker.estimate, last, trained, [last]
                )
                seconds = time.process_time() - began
                rows.append(_row(AT_REST, len(images), seen, truth[-1], seconds))
                if name == names[0]:
                    points = np.stack([one.points for one in found]).astype(np.float32)
                    (rollout,) = recorded(attempts, rope, "tracking", run.key)
                    pictures = RolloutImages(tuple(map(encode_jpeg, images)), points)
                    with run.atomic("recordings/tracked.mcap") as path:
                        facts = {"source": "tracking", "signature": run.key}
                        write_recording(path, [replace(rollout, camera=pictures)], facts)
        pixels = true_camera.project(truth[-1])
        moved = Observation.of(camera.unproject(pixels[:, :2], pixels[:, 2]))
        rows.append(_row(MISPLACED, len(images), moved, truth[-1]))
        table = pd.DataFrame(rows).assign(level=int(level), action=action, rollout=name)
        return table.round({"mean_error_mm": 3, "seconds": 4})

    run.table("tracks.csv", track, names, "tracking")


def _row(
    method: str, frame: int, found: Any, truth: NDArray, seconds: float = 0.0, moving: bool = False
) -> dict[str, Any]:
    """A row of the table."""
    state = state_or_none(truth)
    return {
        "method": method,
        "frame": frame,
        "mean_error_mm": 1e3 * np.linalg.norm(found.points - truth, axis=1).mean(),
        "state_correct": int(state is not None and found.state == state),
        "lost": int(any("lost" in one for one in found.ambiguities)),
        "moving": int(moving),
        "seconds": seconds,
    }

"""Stage `tracking`: ropes followed through whole rollouts of all actions, image by image.

The ropes differ from the planner's, and the camera stands not quite where it is believed to be, as
in the closed loop. Every tracker begins with the true shape: how well an image alone gives it is
the perception experiment's question.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.execution import LstmDynamics, ModelPrediction, MujocoDynamics, Observation
from knotflow.execution.control.film import film_rollout
from knotflow.perception import (
    Camera,
    CameraNoiseConfig,
    PointDriftConfig,
    PointDriftTracker,
    RgbdImage,
    Tracker,
    TrackerConfig,
    network_of,
)
from knotflow.perception.training_config import SHIPPED_NETWORK
from knotflow.recording import RecordedRollout, RolloutImages, write_recording
from knotflow.samplers.demonstrations import SHIPPED, TASKS, load_demonstrations
from knotflow.simulation import (
    Attempts,
    RopeConfig,
    SimulationConfig,
    grasped_link,
    perturb_rope,
    state_or_none,
)
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import recorded

TABLE = "tracks.csv"
RECORDING = "recordings/tracked.mcap"
TRACKER, AT_REST = "rendering_mujoco", "rendering_mujoco_at_rest"
"""Gradient steps on the rendering from what the planner's simulator predicts; and the tracked rope
looked at once more with care, when it has come to rest and the gripper has left the image."""
MISPLACED = "camera_misplaced"
"""The true rope at rest, moved by how far the camera stands from where it is believed to be."""


@dataclass(kw_only=True)
class TrackingConfig:
    """What is tracked, and how."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator, around whose rope ropes are drawn; its record rate is the camera's."""
    demonstrations: str = runtime(str(SHIPPED))
    """Starts and splines of the rollouts; what counts is `digest`."""
    digest: str
    """Of that file."""
    noise: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    """Of the camera, nominal at every level."""
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    """The tracker."""
    drift: PointDriftConfig = field(default_factory=PointDriftConfig)
    """The yardstick."""
    weights: str = runtime("")
    """File of the learned dynamics; what counts is `weights_contents`."""
    weights_contents: str
    """Digest of what the file holds."""
    network: str = runtime(str(SHIPPED_NETWORK))
    """File of the network with which a lost rope is found; what counts is `network_contents`."""
    network_contents: str
    """Digest of what the file holds, or its name where there is none."""
    levels: list[int]
    """How far ropes and camera are from what is believed, see `execution.ERROR_LEVELS`."""
    rollouts: int
    """Of each action at each level."""
    seed: int
    """Of ropes, cameras and noise; used for nothing else."""


@stage("tracking", inputs=(), version=3)
def track_rollouts(
    config: TrackingConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes tracks.csv (a row a method and frame) and a recording of a rollout with its images."""
    names = [
        f"{level}-{task.name}-{number}"
        for level in config.levels
        for task in TASKS
        for number in range(config.rollouts)
    ]
    context.table(TABLE, partial(_track, config, names[0]), names, "tracking")


def _track(config: TrackingConfig, shown: str, context: StageContext, name: str) -> pd.DataFrame:
    """One rollout; that of the name `shown` is recorded with its images."""
    level, action, number = name.split("-")
    rng = np.random.default_rng([config.seed, int(level), *map(ord, action), int(number)])
    rope = perturb_rope(config.simulation.rope, int(level), rng)
    demonstrations = load_demonstrations(Path(config.demonstrations))
    of_action = [one for one in demonstrations if one.task.name == action]
    film = film_rollout(of_action, rope, int(level), config.simulation, config.noise, rng)
    attempts, (*images, at_rest), (*shows, rest_shows) = film.attempts, film.images, film.visible
    truth = attempts.rollouts.trajectory[0].astype(np.float64)
    camera, believed = Camera.overhead(), config.simulation.rope
    network = network_of(Path(config.network))
    followers = {
        "rendering": None,
        "rendering_lstm": ModelPrediction(LstmDynamics.load(Path(config.weights))),
        TRACKER: ModelPrediction(MujocoDynamics(replace(config.simulation, threads=1))),
    }
    makers: dict[str, Callable[[], Tracker | PointDriftTracker]] = {
        method: partial(Tracker, camera, believed, truth[0], config.tracker, prediction, network)
        for method, prediction in followers.items()
    } | {
        "point_drift": lambda: PointDriftTracker(camera, believed, truth[0], config.drift),
        "point_drift_predicted": lambda: PointDriftTracker(
            camera, believed, truth[0], replace(config.drift, predict=True)
        ),
    }
    held = attempts.rollouts.times < config.simulation.move_time - 1e-6
    held[0] = False
    link = int(grasped_link(attempts.splines[0], rope.links))
    rows: list[dict[str, Any]] = []
    for method, make in makers.items():
        tracker, found = make(), []
        for frame, image in enumerate(images):
            began = time.process_time()
            gripper = attempts.rollouts.gripper[0, frame].astype(np.float64)
            found.append(tracker.update(image, gripper, link if held[frame] else None))
            rows.append(
                _row(method, frame, found[-1], truth[frame])
                | {"visible_share": shows[frame].mean(), "moving": int(held[frame])}
                | {"seconds": time.process_time() - began}
            )
        if method == TRACKER and isinstance(tracker, Tracker):
            began = time.process_time()
            rest = _row(AT_REST, len(images), tracker.look(at_rest), truth[-1])
            rest |= {"visible_share": rest_shows.mean(), "moving": 0}
            rows.append(rest | {"seconds": time.process_time() - began})
            if name == shown:
                points = np.stack([one.points for one in found]).astype(np.float32)
                _record(context, rope, attempts, RolloutImages(tuple(map(_jpeg, images)), points))
    pixels = film.camera.project(truth[-1])
    moved = Observation.of(camera.unproject(pixels[:, :2], pixels[:, 2]))
    rows.append(
        _row(MISPLACED, len(images), moved, truth[-1])
        | {"visible_share": 1.0, "moving": 0, "seconds": 0.0}
    )
    table = pd.DataFrame(rows).assign(level=int(level), action=action, rollout=name)
    return table[COLUMNS].round({"mean_error_mm": 3, "visible_share": 3, "seconds": 4})


COLUMNS = [
    *("method", "level", "action", "rollout", "frame", "mean_error_mm", "visible_share"),
    *("state_correct", "lost", "moving", "seconds"),
]


def _row(method: str, frame: int, found: Any, truth: NDArray) -> dict[str, Any]:
    state = state_or_none(truth)
    return {
        "method": method,
        "frame": frame,
        "mean_error_mm": 1e3 * np.linalg.norm(found.points - truth, axis=1).mean(),
        "state_correct": int(state is not None and found.state == state),
        "lost": int(any("lost" in doubt for doubt in found.doubts)),
    }


def _record(
    context: StageContext, rope: RopeConfig, attempts: Attempts, camera: RolloutImages
) -> None:
    (rollout,) = recorded(attempts, rope, "tracking", context.signature)
    with context.atomic(RECORDING) as path:
        whole: RecordedRollout = replace(rollout, camera=camera)
        write_recording(path, [whole], {"source": "tracking", "signature": context.signature})


def _jpeg(image: RgbdImage) -> bytes:
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(image.rgb).save(file, "jpeg", quality=85)  # noise makes a PNG large
    return file.getvalue()

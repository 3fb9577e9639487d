"""Rope dynamics: how a rope moves with the gripper that drags it, in steps of `STEP` seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.motions import FREE, STEP, Motions
from knotflow.simulation import SimulationConfig, build_model, pose, resample

if TYPE_CHECKING:
    import pandas as pd
    from torch import Tensor

SHIPPED_DYNAMICS = Path(__file__).parent / "data" / "dynamics.safetensors"
"""The shipped weights."""

JUDGED_STEPS = (1, 10, 25)  # steps after which predictions are judged; 25 are a whole motion

CHUNK = 64  # ropes simulated at once
RIDGE = 1e-6  # weight of the coordinates' velocities beside the vertices', square metres


@dataclass
class LstmConfig:
    """The network, and the rope it is for."""

    hidden: int = 128  # size of each direction's state
    layers: int = 1
    group: int = 4  # neighbouring vertices that are read at a time
    links: int = 40  # of the rope
    length: float = 1.0  # of the rope, metres
    straightening: int = 4  # passes over the links that bring them back towards their length


@dataclass
class DynamicsTrainingConfig:
    """Training of the learned dynamics."""

    network: LstmConfig = field(default_factory=LstmConfig)
    validations: int = 120  # and checkpoints, until the end
    steps: int = 200  # gradient steps between two of them
    batch: int = 48  # parts of motions in a gradient step
    horizon: int = 10  # steps of the longest rollouts; training begins with 2
    learning_rate: float = 3e-3  # at first; it falls to a hundredth along a cosine
    weight_decay: float = 1e-4  # of AdamW
    gradient_norm: float = 0.1  # to which gradients are cut
    noise: float = 0.0003  # standard deviation on the first vertices, metres
    held_out: float = 0.05  # share of the motions, the last ones, for validation


class RopeDynamics(Protocol):
    """Predicts ropes of V vertices; metres, metres per second, world frame."""

    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """Vertices (B, H, V, 3) float32 at the end of each of H steps.

        From vertices and their velocities (B, V, 3), the index (B,) or (B, H) of the dragged link
        or `FREE`, and the gripper (B, H, 3) at the end of each step.
        """


class StaticDynamics:
    """A rope that stays where it is: the baseline."""

    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        return points[:, None].expand(-1, gripper.shape[1], -1, -1).float()


class MujocoDynamics:
    """The planner's simulator as a model; between two steps the gripper is interpolated."""

    def __init__(self, config: SimulationConfig | None = None) -> None:
        import mujoco
        from mujoco.batch import Batch

        self.config = config or SimulationConfig()
        rope = self.config.rope
        self._model = build_model(rope, self.config.timestep, self.config.contact_time)
        self._data = mujoco.MjData(self._model)
        self._vertices = [self._model.site(f"vertex_{i}").id for i in range(rope.num_vertices)]
        self._batch = Batch(self._model, CHUNK, max(1, self.config.threads))

    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """See `RopeDynamics`. Links are made equal first; a diverged rope stays where it was."""
        import torch

        start, speed, path = (np.asarray(one.double()) for one in (points, velocities, gripper))
        held = np.asarray(grasped_at_each_step(grasped, gripper.shape[1]))
        rows = np.array_split(np.arange(len(held)), -(-len(held) // CHUNK) or 1)
        parts = [self._predict(start[r], speed[r], held[r], path[r]) for r in rows]
        return torch.from_numpy(np.concatenate(parts)).float()

    def _predict(
        self, points: NDArray, velocities: NDArray, grasped: NDArray, gripper: NDArray
    ) -> NDArray[np.float64]:
        import mujoco

        rope, batch, count = self.config.rope, self._batch, len(points)
        points = np.stack([resample(one, rope) for one in points])
        qpos = pose(points, rope)
        substeps = round(STEP / self.config.timestep)
        path = self._gripper_path(points, velocities, grasped[:, 0], gripper, substeps)
        total = path.shape[1]
        control = np.zeros((count, total, rope.links + 3))
        row, step = np.nonzero(np.repeat(grasped, substeps, axis=1) != FREE)
        control[row, step, grasped[row, step // substeps]] = 1.0
        control[:, -1, : rope.links] = control[:, -2, : rope.links]
        control[:, :, rope.links :] = path
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        batch.qpos[:count] = qpos
        batch.qvel[:count] = [
            self._hinge_velocities(*one) for one in zip(qpos, velocities, strict=True)
        ]
        controlled = int(mujoco.mjtState.mjSTATE_EQ_ACTIVE | mujoco.mjtState.mjSTATE_MOCAP_POS)
        recorded = batch.rollout(
            total, control, controlled, record=["site_xpos"], ids=np.arange(count)
        )["site_xpos"].reshape(count, total, -1, 3)[:, :, self._vertices]
        # MuJoCo places sites before it integrates: a step's end is read in the next step.
        ahead = recorded[:, np.arange(substeps, total, substeps)]
        # A diverged rope is put back to the reference pose and stops there.
        warned = np.asarray(batch.warning)[:count, :, 1].any(axis=1, keepdims=True)
        stopped = np.equal(ahead, recorded[:, -1:]).all(axis=(2, 3))
        blown = (warned & stopped) | ~np.isfinite(ahead).all(axis=(2, 3))
        before = points
        for here, lost in zip(ahead.swapaxes(0, 1), blown.T, strict=True):
            here[lost] = before[lost]
            before = here
        return ahead

    def _gripper_path(
        self,
        points: NDArray,
        velocities: NDArray,
        grasped: NDArray,
        gripper: NDArray,
        substeps: int,
    ) -> NDArray[np.float64]:
        """The gripper (B, H * substeps + 1, 3) in every time step and one more.

        MuJoCo's grip is critically damped with `contact_time`, so that the dragged link trails a
        steady gripper by twice that time.
        """
        from scipy.interpolate import PchipInterpolator

        begin = gripper[:, 0].copy()
        held = np.flatnonzero(grasped != FREE)
        ahead = points + 2 * self.config.contact_time * velocities
        begin[held] = (ahead[held, grasped[held]] + ahead[held, grasped[held] + 1]) / 2
        knots = np.concatenate([begin[:, None], gripper], axis=1)  # (B, H + 1, 3)
        last = gripper.shape[1]
        at = np.minimum(np.arange(1, last * substeps + 2) / substeps, last)
        path: NDArray[np.float64] = PchipInterpolator(np.arange(last + 1), knots, axis=1)(at)
        return path

    def _hinge_velocities(self, qpos: NDArray, velocities: NDArray) -> NDArray[np.float64]:
        """The coordinates' velocities (nv,) for the vertices' (V, 3), by regularized least squares:
        the rope's roll is seen in no vertex."""
        import mujoco

        if not velocities.any():
            return np.zeros(self._model.nv)
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        jacobian = np.empty((len(self._vertices), 3, self._model.nv))
        for part, site in zip(jacobian, self._vertices, strict=True):
            mujoco.mj_jacSite(self._model, self._data, part, None, site)
        jacobian = jacobian.reshape(-1, self._model.nv)
        normal = jacobian.T @ jacobian + RIDGE * np.eye(self._model.nv)
        solved: NDArray[np.float64] = np.linalg.solve(normal, jacobian.T @ velocities.ravel())
        return solved


@dataclass(frozen=True)
class ModelPrediction:
    """A model as the prediction of a `perception.Tracker`, interpolated between its steps."""

    dynamics: RopeDynamics

    def __call__(
        self,
        points: NDArray,
        velocities: NDArray,
        seconds: float,
        gripper: NDArray | None,
        grasped: int | None,
    ) -> NDArray[np.float64]:
        """The rope (V, 3) after some seconds, when the gripper is at (3,), metres."""
        import torch

        if seconds <= 0:
            return points.copy()
        steps = int(np.ceil(seconds / STEP - 1e-6))
        link = FREE if gripper is None or grasped is None else grasped
        path = np.zeros((steps, 3))  # a free rope's gripper does not matter
        if link != FREE:
            centre = points[link : link + 2].mean(axis=0)
            share = STEP * np.arange(1, steps + 1) / seconds  # beyond the image by part of a step
            path = centre + share[:, None] * (np.asarray(gripper) - centre)
        start, speed, way = (
            torch.as_tensor(one, dtype=torch.float32)[None] for one in (points, velocities, path)
        )
        ahead = self.dynamics.predict(start, speed, torch.tensor([link]), way)
        shapes = np.concatenate([points[None], ahead[0].numpy().astype(np.float64)])
        left = (steps * STEP - seconds) / STEP  # of the last step
        after: NDArray[np.float64] = (1 - left) * shapes[-1] + left * shapes[-2]
        return after


def grasped_at_each_step(grasped: Tensor, steps: int) -> Tensor:
    """Indices (B, H) of the dragged links, from (B,) or (B, H)."""
    return grasped.reshape(len(grasped), -1).expand(-1, steps)


def motion_errors(model: RopeDynamics, motions: Motions) -> NDArray[np.float64]:
    """Distance (N, T - 1, V) of vertices predicted from the first frame from the true, metres."""
    import torch

    points = torch.from_numpy(motions.points[:, 0])
    gripper, grasped = torch.from_numpy(motions.gripper), torch.from_numpy(motions.grasped)
    with torch.no_grad():
        ahead = model.predict(points, torch.zeros_like(points), grasped[:, :-1], gripper[:, 1:])
    return np.linalg.norm(ahead.numpy() - motions.points[:, 1:], axis=-1)


def prediction_errors(models: Mapping[str, RopeDynamics], motions: Motions) -> pd.DataFrame:
    """A row a model, level and number of steps: model, level, steps, motions, mean_error_mm."""
    import pandas as pd

    rows = []
    for name, model in models.items():
        errors = 1e3 * motion_errors(model, motions).mean(axis=-1)
        for level in np.unique(motions.level):
            of_level = motions.level == level
            for steps in JUDGED_STEPS:
                mean = float(errors[of_level, steps - 1].mean())
                rows.append((name, level, steps, of_level.sum(), round(mean, 2)))
    columns = ["model", "level", "steps", "motions", "mean_error_mm"]
    return pd.DataFrame(rows, columns=columns)

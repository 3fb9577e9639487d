"""How a rope moves with the gripper that drags it: one protocol, and what it is measured against.

A model sees a rope's vertices and their velocities and what the gripper will do, and predicts
where the vertices will be, a step of `STEP` seconds at a time. It knows nothing of which rope it
is: friction, stiffness and weight are the planner's or an average.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.rope_motions import FREE, STEP
from knotflow.simulation import SimulationConfig, build_model, pose, resample

if TYPE_CHECKING:
    from torch import Tensor


class RopeDynamics(Protocol):
    """Predicts ropes of V vertices; metres, metres per second, world frame."""

    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """The rope at the end of each of H steps.

        Args:
            points: (B, V, 3) vertices now.
            velocities: (B, V, 3) of the vertices.
            grasped: (B,) index of the link whose centre the gripper drags, or `FREE`.
            gripper: (B, H, 3) where the gripper will be at the end of each step.

        Returns:
            (B, H, V, 3) float32 vertices.
        """
        ...


class Still:
    """A rope that stays where it is: what any model must beat."""

    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """See `RopeDynamics`."""
        return points[:, None].expand(-1, gripper.shape[1], -1, -1).float()


class MujocoDynamics:
    """The planner's simulator as a model: exact for the planner's rope, and slow.

    Like `RopeSimulator`, it shows ropes as they were at the beginning of a frame's last time step.
    """

    def __init__(self, config: SimulationConfig | None = None) -> None:
        from mujoco.batch import Batch

        self.config = config or SimulationConfig()
        rope = self.config.rope
        self._model = build_model(rope, self.config.timestep, self.config.contact_time)
        self._vertices = [self._model.site(f"vertex_{i}").id for i in range(rope.num_vertices)]
        self._batch = Batch(self._model, CHUNK, max(1, self.config.threads))

    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """See `RopeDynamics`. Ropes are brought to equal links first; a simulation that blows up
        stays where it was last."""
        import torch

        start, speed, path = (np.asarray(one.double()) for one in (points, velocities, gripper))
        held = np.asarray(grasped)
        rows = np.array_split(np.arange(len(held)), -(-len(held) // CHUNK) or 1)
        parts = [self._predict(start[r], speed[r], path[r], held[r]) for r in rows]
        return torch.from_numpy(np.concatenate(parts)).float()

    def _predict(
        self, points: NDArray, velocities: NDArray, gripper: NDArray, grasped: NDArray
    ) -> NDArray[np.float64]:
        import mujoco

        rope, batch, count = self.config.rope, self._batch, len(points)
        before = np.stack([resample(one, rope) for one in points - velocities * DIFFERENCE])
        now = np.stack([resample(one, rope) for one in points])
        qpos, earlier = pose(now, rope), pose(before, rope)
        qvel = np.zeros((count, self._model.nv))
        for row in range(count):
            mujoco.mj_differentiatePos(self._model, qvel[row], DIFFERENCE, earlier[row], qpos[row])
        substeps = round(STEP / self.config.timestep)
        share = np.arange(1, substeps + 1)[:, None] / substeps
        held = np.flatnonzero(grasped != FREE)
        begin = gripper[:, 0].copy()
        begin[held] = (now[held, grasped[held]] + now[held, grasped[held] + 1]) / 2
        knots = np.concatenate([begin[:, None], gripper], 1)[:, :, None]  # (B, H + 1, 1, 3)
        path = knots[:, :-1] + (knots[:, 1:] - knots[:, :-1]) * share
        path = path.reshape(count, -1, 3)
        control = np.zeros((count, path.shape[1], rope.links + 3))
        control[held, :, grasped[held]] = 1.0
        control[:, :, rope.links :] = path
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        batch.qpos[:count], batch.qvel[:count] = qpos, qvel
        recorded = batch.rollout(
            path.shape[1],
            control,
            int(mujoco.mjtState.mjSTATE_EQ_ACTIVE | mujoco.mjtState.mjSTATE_MOCAP_POS),
            record=["site_xpos"],
            ids=np.arange(count),
        )["site_xpos"].reshape(count, path.shape[1], -1, 3)
        vertices = recorded[:, substeps - 1 :: substeps, self._vertices]
        return np.where(np.isfinite(vertices), vertices, points[:, None])


CHUNK = 64
"""Ropes simulated at once."""

DIFFERENCE = 0.005
"""Seconds over which velocities of vertices become velocities of hinges."""

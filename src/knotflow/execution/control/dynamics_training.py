"""Training of the learned dynamics on multi-step rollouts (Sec. VI, [15])."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from knotflow.execution.control.dynamics import JUDGED_STEPS, DynamicsTrainingConfig, motion_errors
from knotflow.execution.control.lstm_dynamics import LstmDynamics
from knotflow.execution.control.motions import STEP, Motions
from knotflow.training.trainer import Metrics, SupervisedTrainer

MAX_VALIDATED = 256  # held-out motions


class DynamicsTrainer(SupervisedTrainer):
    """Trains `model` on parts of motions."""

    measure = "error_mm"
    model: LstmDynamics

    def __init__(self, motions: Motions, config: DynamicsTrainingConfig, seed: int) -> None:
        """Motions of the same rope stand side by side; they are two or more.

        Raises:
            ValueError: fewer than two motions, or of another number of vertices.
        """
        vertices = config.network.links + 1
        if len(motions) < 2 or motions.points.shape[2] != vertices:
            raise ValueError(
                f"training needs two or more motions of ropes of {vertices} vertices, got points "
                f"of shape {motions.points.shape}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = LstmDynamics(config.network)
        super().__init__(model, config, seed)
        self.config = config
        held = max(1, round(config.held_out * len(motions)))
        self._held_out = motions[-held:][:MAX_VALIDATED]
        learned = motions[:-held]
        self._points = torch.from_numpy(learned.points)
        self._gripper = torch.from_numpy(learned.gripper)
        self._grasped = torch.from_numpy(learned.grasped)

    def validate(self) -> Metrics:
        """Mean error (mm) of held-out motions after each number of `JUDGED_STEPS`, from rest."""
        errors = 1e3 * motion_errors(self.model, self._held_out).mean(axis=(0, 2))  # (T - 1,)
        return {f"validation_{steps}_mm": float(errors[steps - 1]) for steps in JUDGED_STEPS}

    def update(self, step: int) -> float:
        """Mean error of a batch, millimetres."""
        done = self.fraction(step)
        horizon = min(self.config.horizon, 2 + 2 * int(8 * done))
        points, velocities, grasped, gripper, truth = self._batch(horizon)
        ahead = self.model.predict(points, velocities, grasped, gripper)
        error = (ahead - truth).norm(dim=-1)  # (B, H, V)
        # Far steps are wrong by more, and must not drown the near ones.
        scale = torch.arange(1, horizon + 1).sqrt()[:, None]
        cosine = 0.5 * (1 + math.cos(math.pi * done))
        rate = self.config.learning_rate * (0.01 + 0.99 * cosine)
        self.descend((error / scale).mean(), rate)
        return 1e3 * float(error.detach().mean())

    def _batch(self, horizon: int) -> tuple[Tensor, ...]:
        """Parts of motions, mirrored and reversed at random."""
        count, frames = self.config.batch, self._points.shape[1]
        row = self._draw(len(self._points), count)
        first = self._draw(frames - horizon, count)
        frame = first[:, None] + torch.arange(horizon + 1)
        points, gripper = self._points[row[:, None], frame], self._gripper[row[:, None], frame]
        grasped = self._grasped[row[:, None], frame]
        before = self._points[row, (first - 1).clamp(min=0)]
        mirror = torch.ones(count, 3)
        mirror[:, 1] -= 2 * self._draw(2, count)
        points, before = points * mirror[:, None, None], before * mirror[:, None]
        gripper = gripper * mirror[:, None]
        reverse = self._draw(2, count).bool()
        points = torch.where(reverse[:, None, None, None], points.flip(2), points)
        before = torch.where(reverse[:, None, None], before.flip(1), before)
        other = torch.where(grasped >= 0, points.shape[2] - 2 - grasped, grasped)
        grasped = torch.where(reverse[:, None], other, grasped)
        now = points[:, 0]
        velocities = (now - before) / STEP
        noise = torch.randn(now.shape, generator=self.generator) * self.config.noise
        return now + noise, velocities, grasped[:, :-1], gripper[:, 1:], points[:, 1:]

    def _draw(self, high: int, count: int) -> Tensor:
        return torch.randint(high, (count,), generator=self.generator)

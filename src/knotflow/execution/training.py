"""Training of the learned dynamics on multi-step rollouts (Sec. VI, [15])."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from knotflow.execution.errors import STEPS, predict_motions
from knotflow.execution.lstm import LstmDynamics
from knotflow.execution.rope_motions import STEP, Motions
from knotflow.execution.training_config import DynamicsTrainingConfig

VALIDATION = 256
"""Motions that are held out, most."""


class DynamicsTraining:
    """Trains a model on parts of motions; iterating trains, and gives metrics per validation.

        for metrics in training:
            training.save(path)
        training.model.save(path)

    It may be interrupted after any item, and goes on from what was saved as if it had not been.
    """

    def __init__(self, motions: Motions, config: DynamicsTrainingConfig, seed: int) -> None:
        """Draws the first weights from `seed`.

        Args:
            motions: what is learned from, two or more, those of the same rope side by side.
            config: the effort.
            seed: everything random comes from it.

        Raises:
            ValueError: fewer than two motions, or such of another number of vertices.
        """
        vertices = config.network.links + 1
        if len(motions) < 2 or motions.points.shape[2] != vertices:
            raise ValueError(
                f"training needs two or more motions of ropes of {vertices} vertices, got points "
                f"of shape {motions.points.shape}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.model = LstmDynamics(config.network)
        self.config = config
        held = max(1, round(config.held_out * len(motions)))
        self._held_out = motions[-held:][:VALIDATION]
        learned = motions[:-held]
        self._points = torch.from_numpy(learned.points)
        self._gripper = torch.from_numpy(learned.gripper)
        self._grasped = torch.from_numpy(learned.grasped)
        self._generator = torch.Generator().manual_seed(seed)
        self._optimizer = torch.optim.AdamW(
            self.model.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        self.history: list[dict[str, float]] = []
        """The metrics so far, an item a validation."""

    def __iter__(self) -> Iterator[dict[str, float]]:
        while len(self.history) < self.config.validations:
            first = len(self.history) * self.config.steps
            errors = [self._step(first + step) for step in range(self.config.steps)]
            self.history.append({"error_mm": 1e3 * float(np.mean(errors))} | self.validate())
            yield self.history[-1]

    def validate(self) -> dict[str, float]:
        """Mean error (mm) of held-out motions after each number of `STEPS`, from rest."""
        away = predict_motions(self.model, self._held_out).numpy() - self._held_out.points[:, 1:]
        error = 1e3 * np.linalg.norm(away, axis=-1).mean(axis=(0, 2))  # (T - 1,)
        return {f"validation_{steps}_mm": float(error[steps - 1]) for steps in STEPS}

    def save(self, path: Path) -> None:
        """Write all that is needed to go on."""
        torch.save(
            {
                "model": self.model.state_dict(),
                "optimizer": self._optimizer.state_dict(),
                "generator": self._generator.get_state(),
                "history": self.history,
            },
            path,
        )

    def load(self, path: Path) -> None:
        """Go on from what `save` wrote, of a training with the same arguments."""
        state = torch.load(path, weights_only=True)
        self.model.load_state_dict(state["model"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._generator.set_state(state["generator"])
        self.history = list(state["history"])

    def _step(self, step: int) -> float:
        """Mean error of a batch, metres."""
        config = self.config
        done = step / (config.validations * config.steps)
        for group in self._optimizer.param_groups:
            cosine = 0.5 * (1 + math.cos(math.pi * done))
            group["lr"] = config.learning_rate * (0.01 + 0.99 * cosine)
        horizon = min(config.horizon, 2 + 2 * int(8 * done))
        points, velocities, grasped, gripper, truth = self._batch(horizon)
        ahead = self.model.predict(points, velocities, grasped, gripper)
        error = (ahead - truth).norm(dim=-1)  # (B, H, V)
        self._optimizer.zero_grad(set_to_none=True)
        # Far steps are wrong by more, and must not drown the near ones.
        scale = torch.arange(1, horizon + 1).sqrt()[:, None]
        (error / scale).mean().backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), config.gradient_norm)
        self._optimizer.step()
        return float(error.detach().mean())

    def _batch(self, horizon: int) -> tuple[Tensor, ...]:
        """Parts of motions, mirrored and reversed at random: laws that ropes obey."""
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
        noise = torch.randn(now.shape, generator=self._generator) * self.config.noise
        return now + noise, velocities, grasped[:, :-1], gripper[:, 1:], points[:, 1:]

    def _draw(self, high: int, count: int) -> Tensor:
        return torch.randint(high, (count,), generator=self._generator)

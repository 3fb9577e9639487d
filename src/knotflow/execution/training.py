"""Training of the learned dynamics on multi-step rollouts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from knotflow.execution.lstm import LstmConfig, LstmDynamics
from knotflow.execution.rope_motions import STEP, Motions


@dataclass
class DynamicsTrainingConfig:
    """How the dynamics are trained."""

    network: LstmConfig = field(default_factory=LstmConfig)
    """What is trained."""
    steps: int = 4000
    """Gradient steps."""
    batch: int = 48
    """Rollouts in a gradient step."""
    horizon: int = 10
    """Longest rollout that is learned from, in steps of 0.1 s; training begins with one of 2."""
    learning_rate: float = 3e-3
    """At first; it falls to nothing along a cosine."""
    noise: float = 0.0003
    """Standard deviation of the error of the first vertices, metres: estimates have some."""


class DynamicsTraining:
    """Trains a model; iterating gives the mean error of each step's batch, metres.

    It goes on from where `save` left it: batches are drawn by a generator that is saved too.
    """

    def __init__(self, motions: Motions, config: DynamicsTrainingConfig, seed: int) -> None:
        torch.manual_seed(seed)
        self.config = config
        self.model = LstmDynamics(config.network)
        self._points = torch.from_numpy(motions.points)
        self._gripper = torch.from_numpy(motions.gripper)
        self._grasped = torch.from_numpy(motions.grasped)
        self._generator = torch.Generator().manual_seed(seed)
        self._optimizer = torch.optim.AdamW(
            self.model.parameters(), config.learning_rate, weight_decay=1e-4
        )
        self._schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
            self._optimizer, config.steps, config.learning_rate / 100
        )
        self.step = 0

    def __iter__(self) -> Iterator[float]:
        while self.step < self.config.steps:
            horizon = min(self.config.horizon, 2 + 2 * (8 * self.step // self.config.steps))
            points, velocities, grasped, gripper, truth = self._batch(horizon)
            ahead = self.model.predict(points, velocities, grasped, gripper)
            error = (ahead - truth).norm(dim=-1)
            self._optimizer.zero_grad()
            # Far steps are wrong by more, and must not drown the near ones.
            scale = torch.arange(1, horizon + 1).sqrt()[:, None]
            (error / scale).mean().backward()
            torch.nn.utils.clip_grad_norm_(self.model.parameters(), 0.1)
            self._optimizer.step()
            self._schedule.step()
            self.step += 1
            yield error.mean().item()

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

    def save(self, path: Path) -> None:
        """Write all that is needed to go on; a file that is half written replaces none."""
        part = path.with_suffix(".part")
        torch.save(self._state(), part)
        part.replace(path)

    def load(self, path: Path) -> None:
        """Go on from a file that `save` wrote, of a training with the same arguments."""
        state = torch.load(path, weights_only=True)
        self.model.load_state_dict(state["model"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._schedule.load_state_dict(state["schedule"])
        self._generator.set_state(state["generator"])
        self.step = state["step"]

    def _state(self) -> dict[str, Any]:
        return {
            "model": self.model.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "schedule": self._schedule.state_dict(),
            "generator": self._generator.get_state(),
            "step": self.step,
        }

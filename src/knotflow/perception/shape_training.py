"""What trainings on rope shapes have in common: batches, steps, and going on where one stopped."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from knotflow.perception.training_config import EffortConfig


class ShapeTraining(ABC):
    """Training on simulated ropes; iterating over it trains, and gives metrics per validation.

        for metrics in training:
            training.save(path)

    It may be interrupted after any item, and goes on from what was saved as if it had not been.
    """

    def __init__(
        self, model: nn.Module, points: NDArray, crossings: NDArray, config: EffortConfig, seed: int
    ) -> None:
        """Hold the last shapes out.

        Args:
            model: that learns.
            points: (N, V, 3) shapes at rest, metres; ones that come from one another side by side.
            crossings: (N,) of each shape; every number of crossings is drawn equally often.
            config: the effort.
            seed: everything random comes from it.

        Raises:
            ValueError: fewer than two shapes.
        """
        if len(points) < 2:
            raise ValueError(f"training needs shapes (N, V, 3), two or more; got {points.shape}")
        self.model, self._effort = model, config
        self.generator = torch.Generator().manual_seed(seed)
        held = max(1, round(config.held_out * len(points)))
        shapes = torch.as_tensor(np.asarray(points), dtype=torch.float32)
        self._shapes, self._unseen = shapes[:-held], shapes[-held:]
        counts = np.bincount(crossings[:-held])
        self._weights = torch.as_tensor(1.0 / counts[crossings[:-held]])
        self._optimizer = torch.optim.AdamW(
            model.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        self.history: list[dict[str, float]] = []
        """The metrics so far, an item a validation."""

    def __iter__(self) -> Iterator[dict[str, float]]:
        while len(self.history) < self._effort.validations:
            self.model.train()
            first = len(self.history) * self._effort.steps
            losses = [self._step(first + step) for step in range(self._effort.steps)]
            self.history.append({"loss": float(np.mean(losses))} | self.validate())
            yield self.history[-1]

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Metrics on the shapes that are held out."""

    @abstractmethod
    def _loss(self, shapes: Tensor) -> Tensor:
        """Of a batch of shapes (N, V, 3), metres, seen at random."""

    def save(self, path: Path) -> None:
        """Write all that is needed to go on."""
        torch.save(self.state_dict(), path)

    def load(self, path: Path) -> None:
        """Go on from what `save` wrote, of a training with the same arguments."""
        self.load_state_dict(torch.load(path, weights_only=True))

    def state_dict(self) -> dict[str, Any]:
        """All that changes while it trains."""
        return {
            "model": self.model.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "generator": self.generator.get_state(),
            "history": self.history,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` gave."""
        self.model.load_state_dict(state["model"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])
        self.history = list(state["history"])

    def _step(self, step: int) -> float:
        config = self._effort
        total = config.validations * config.steps
        warm = min(1.0, (step + 1) / config.steps)
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * step / total))
        chosen = torch.multinomial(
            self._weights, config.batch, replacement=True, generator=self.generator
        )
        loss = self._loss(self._shapes[chosen])
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), config.gradient_norm)
        self._optimizer.step()
        return float(loss.detach())

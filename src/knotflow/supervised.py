"""Supervised training in stretches, each with a validation, that goes on where it stopped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn


class Effort(Protocol):
    """What every such training is given."""

    validations: int
    steps: int
    learning_rate: float
    weight_decay: float
    gradient_norm: float


class SupervisedTraining(ABC):
    """Iterating over it trains, and gives metrics per validation.

        for metrics in training:
            training.save(path)

    It may be interrupted after any item, and goes on from what was saved as if it had not been.
    """

    measure = "loss"
    """What the metrics call the mean of what the steps return."""

    def __init__(self, model: nn.Module, effort: Effort, seed: int) -> None:
        self.model, self._effort = model, effort
        self.generator = torch.Generator().manual_seed(seed)
        """Everything random comes from it."""
        self._optimizer = torch.optim.AdamW(
            model.parameters(), effort.learning_rate, weight_decay=effort.weight_decay
        )
        self.history: list[dict[str, float]] = []
        """The metrics so far, an item a validation."""

    def __iter__(self) -> Iterator[dict[str, float]]:
        while len(self.history) < self._effort.validations:
            self.model.train()
            first = len(self.history) * self._effort.steps
            measured = [self._step(first + step) for step in range(self._effort.steps)]
            self.history.append({self.measure: float(np.mean(measured))} | self.validate())
            yield self.history[-1]

    @abstractmethod
    def validate(self) -> dict[str, float]:
        """Metrics on what is held out."""

    @abstractmethod
    def _step(self, step: int) -> float:
        """Take the gradient step of that number; what is measured of it."""

    def _done(self, step: int) -> float:
        """The share of all steps before this one, 0..1."""
        return step / (self._effort.validations * self._effort.steps)

    def _descend(self, loss: Tensor, learning_rate: float) -> None:
        """One gradient step on a loss."""
        for group in self._optimizer.param_groups:
            group["lr"] = learning_rate
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), self._effort.gradient_norm)
        self._optimizer.step()

    def save(self, path: Path) -> None:
        """Write all that is needed to go on."""
        state = {
            "model": self.model.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "generator": self.generator.get_state(),
            "history": self.history,
        }
        torch.save(state, path)

    def load(self, path: Path) -> None:
        """Go on from what `save` wrote, of a training with the same arguments."""
        state = torch.load(path, weights_only=True)
        self.model.load_state_dict(state["model"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])
        self.history = list(state["history"])

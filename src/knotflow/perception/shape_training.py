"""What trainings on rope shapes have in common: which shapes are seen how often."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from knotflow.perception.training_config import EffortConfig
from knotflow.supervised import SupervisedTraining


class ShapeTraining(SupervisedTraining):
    """A `SupervisedTraining` on simulated ropes."""

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
        super().__init__(model, config, seed)
        held = max(1, round(config.held_out * len(points)))
        shapes = torch.as_tensor(np.asarray(points), dtype=torch.float32)
        self._shapes, self._unseen = shapes[:-held], shapes[-held:]
        counts = np.bincount(crossings[:-held])
        self._weights = torch.as_tensor(1.0 / counts[crossings[:-held]])
        self._batch, self._warm, self._highest = config.batch, config.steps, config.learning_rate

    @abstractmethod
    def _loss(self, shapes: Tensor) -> Tensor:
        """Of a batch of shapes (N, V, 3), metres, seen at random."""

    def _step(self, step: int) -> float:
        chosen = torch.multinomial(
            self._weights, self._batch, replacement=True, generator=self.generator
        )
        loss = self._loss(self._shapes[chosen])
        warm = min(1.0, (step + 1) / self._warm)
        cosine = 0.5 * (1 + math.cos(math.pi * self._done(step)))
        self._descend(loss, self._highest * warm * cosine)
        return float(loss.detach())

"""Training the state estimation network on simulated ropes (Sec. VI, [15])."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.coarse_to_fine import CoarseToFine
from knotflow.perception.examples import Examples, draw
from knotflow.perception.network import Network
from knotflow.perception.supervision import crossings_right, nodes_loss, vertex_error
from knotflow.perception.training_config import TrainingConfig
from knotflow.simulation import RopeConfig

VALIDATION = 256
"""Examples that are held out, most."""


class Training:
    """Training on simulated ropes; iterating over it trains, and gives metrics per validation.

        for metrics in training:
            training.save(path)
        training.network.save(path)

    It may be interrupted after any item, and goes on from what was saved as if it had not been.
    """

    def __init__(
        self,
        points: NDArray,
        crossings: NDArray,
        rope: RopeConfig,
        config: TrainingConfig,
        seed: int,
    ) -> None:
        """Draws the first weights from `seed`.

        Args:
            points: (N, V, 3) shapes at rest, metres; ones that come from one another side by side.
            crossings: (N,) of each shape; every number of crossings is drawn equally often.
            rope: its radius.
            config: the effort.
            seed: everything random comes from it.

        Raises:
            ValueError: fewer than two shapes, or with another number of vertices than the network.
        """
        if len(points) < 2 or points.shape[1] != config.network.nodes[-1]:
            raise ValueError(
                f"training needs shapes (N, {config.network.nodes[-1]}, 3), two or more, as the "
                f"network's finest level has that many nodes; got {points.shape}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.model = CoarseToFine(config.network)
        self.rope, self.config = rope, config
        self.generator = torch.Generator().manual_seed(seed)
        held = max(1, round(config.held_out * len(points)))
        shapes = torch.as_tensor(np.asarray(points), dtype=torch.float32)
        self._shapes = shapes[:-held]
        counts = np.bincount(crossings[:-held])
        self._weights = torch.as_tensor(1.0 / counts[crossings[:-held]])
        apart = torch.Generator().manual_seed(seed + 1)
        unseen = shapes[-held:][torch.randperm(held, generator=apart)[:VALIDATION]]
        self._validation = self._draw(unseen, apart)
        self._optimizer = torch.optim.AdamW(
            self.model.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        self.history: list[dict[str, float]] = []
        """The metrics so far, an item a validation."""

    def __iter__(self) -> Iterator[dict[str, float]]:
        while len(self.history) < self.config.validations:
            self.model.train()
            first = len(self.history) * self.config.steps
            losses = [self._step(first + step) for step in range(self.config.steps)]
            self.history.append({"loss": float(np.mean(losses))} | self.validate())
            yield self.history[-1]

    @property
    def network(self) -> Network:
        """What was learned so far."""
        return Network(self.model)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss, mean and median vertex error (mm), and share of crossings the right way round."""
        self.model.eval()
        patches, nodes, half = self._validation
        found = self.model(patches)
        error = 1e3 * half * vertex_error(found[-1].places, nodes)
        right, among = crossings_right(found[-1].places, nodes)
        return {
            "validation_loss": float(nodes_loss(found, nodes, self.config.loss).mean()),
            "validation_error_mm": float(error.mean()),
            "validation_median_mm": float(error.median()),
            "validation_crossings": float(right.sum() / among.sum().clamp(min=1)),
        }

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
        config = self.config
        total = config.validations * config.steps
        warm = min(1.0, (step + 1) / config.steps)
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * step / total))
        chosen = torch.multinomial(
            self._weights, config.batch, replacement=True, generator=self.generator
        )
        batch = self._draw(self._shapes[chosen], self.generator)
        loss = nodes_loss(self.model(batch.patches), batch.nodes, config.loss).mean()
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), config.gradient_norm)
        self._optimizer.step()
        return float(loss.detach())

    def _draw(self, shapes: Tensor, generator: torch.Generator) -> Examples:
        config = self.config
        return draw(shapes, self.rope.radius, config.network.size, config.examples, generator)

"""Training of the strand network on simulated ropes (Sec. VI)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, nll_loss, smooth_l1_loss

from knotflow.perception.networks.network import NextStep, StrandNetwork, StrandNetworkConfig
from knotflow.perception.networks.windows import (
    HEADINGS,
    WIDEST,
    ExamplesConfig,
    Windows,
    draw_windows,
)
from knotflow.training.trainer import SupervisedTrainer

_NEARLY = 0.3  # radians: a heading no further off is right, as strands that meet are further apart


@dataclass
class StrandTrainingConfig:
    """The effort of a training, and what is learned from."""

    network: StrandNetworkConfig = field(default_factory=StrandNetworkConfig)
    examples: ExamplesConfig = field(default_factory=ExamplesConfig)  # how the ropes are seen
    validations: int = 25  # validations, and checkpoints, until the end
    steps: int = 200  # gradient steps between two of them
    batch: int = 192  # examples of a step
    learning_rate: float = 1.5e-3
    """Largest one; it rises over the first validation and falls to nothing as a cosine."""
    weight_decay: float = 1e-3  # AdamW's
    gradient_norm: float = 5.0  # gradients are cut to this length
    held_out: float = 0.05  # share of the shapes, the last ones, that are for validation


def next_step_loss(found: NextStep, truth: Windows) -> Tensor:
    """Mean loss of how strands are said to go on; where the rope ends, of that alone."""
    on = ~truth.end
    ends = binary_cross_entropy_with_logits(found.end, truth.end.float())
    if not on.any():
        return ends
    heading = nll_loss(found.heading[on], truth.heading[on])
    return heading + smooth_l1_loss(found.height[on], truth.next_height[on]) + ends


class StrandTrainer(SupervisedTrainer):
    """Supervised training on simulated ropes, drawn by their number of crossings equally often."""

    model: StrandNetwork

    def __init__(
        self,
        points: NDArray,
        crossings: NDArray,
        radii: NDArray,
        config: StrandTrainingConfig,
        seed: int,
    ) -> None:
        """Draw the first weights and hold the last of the shapes (N, V, 3) of `radii` (N,), metres,
        out; ones that come from one another stand side by side.

        Raises:
            ValueError: fewer than two shapes.
        """
        if len(points) < 2:
            raise ValueError(f"training needs shapes (N, V, 3), two or more; got {points.shape}")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = StrandNetwork(config.network)
        super().__init__(model, config, seed)
        self.config = config
        held = max(1, round(config.held_out * len(points)))
        shapes, each = (
            torch.as_tensor(np.asarray(one), dtype=torch.float32) for one in (points, radii)
        )
        self._shapes, self._radii = shapes[:-held], each[:-held]
        counts = np.bincount(crossings[:-held])
        self._weights = torch.as_tensor(1.0 / counts[crossings[:-held]])
        generator = torch.Generator().manual_seed(seed + 1)
        self._validation = draw_windows(shapes[-held:], each[-held:], config.examples, generator)

    def update(self, step: int) -> float:
        config = self.config
        chosen = torch.multinomial(
            self._weights, config.batch, replacement=True, generator=self.generator
        )
        batch = draw_windows(
            self._shapes[chosen], self._radii[chosen], config.examples, self.generator
        )
        loss = next_step_loss(self.model(batch.windows, batch.height), batch)
        warm = min(1.0, (step + 1) / config.steps)
        cosine = 0.5 * (1 + math.cos(math.pi * self.fraction(step)))
        self.descend(loss, config.learning_rate * warm * cosine)
        return float(loss.detach())

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss, share of headings nearly right, error in height (radii) and share of ends found."""
        self.model.eval()
        truth = self._validation
        found = self.model(truth.windows, truth.height)
        on = ~truth.end
        off = (found.heading[on].argmax(dim=1) - truth.heading[on]).abs() * (2 * WIDEST / HEADINGS)
        return {
            "validation_loss": float(next_step_loss(found, truth)),
            "validation_headings": float((off <= _NEARLY).float().mean()),
            "validation_height": float((found.height - truth.next_height)[on].abs().mean()),
            "validation_ends": float(((found.end > 0) == truth.end).float().mean()),
        }

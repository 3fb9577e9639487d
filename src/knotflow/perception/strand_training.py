"""Training the network that follows strands on simulated ropes (Sec. VI)."""

from __future__ import annotations

import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, nll_loss, smooth_l1_loss

from knotflow.perception.shape_training import ShapeTraining
from knotflow.perception.strand_examples import Windows, draw_windows
from knotflow.perception.strand_network import HEADINGS, WIDEST, Onward, StrandNetwork
from knotflow.perception.training_config import StrandTrainingConfig
from knotflow.simulation import RopeConfig

NEARLY = 0.3
"""A heading that is no further off is right, radians: strands that meet are further apart."""


class StrandTraining(ShapeTraining):
    """A `ShapeTraining` of the network that follows strands."""

    model: StrandNetwork

    def __init__(
        self,
        points: NDArray,
        crossings: NDArray,
        rope: RopeConfig,
        config: StrandTrainingConfig,
        seed: int,
    ) -> None:
        """Draws the first weights from `seed`; arguments as those of `Training`."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = StrandNetwork(config.network)
        super().__init__(model, points, crossings, config, seed)
        self.rope, self.config = rope, config
        self._validation = self._draw(self._unseen, torch.Generator().manual_seed(seed + 1))

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss, share of headings nearly right, error in height (radii) and share of ends found."""
        self.model.eval()
        truth = self._validation
        found = self.model(truth.windows, truth.height)
        on = ~truth.end
        off = (found.heading[on].argmax(dim=1) - truth.heading[on]).abs() * (2 * WIDEST / HEADINGS)
        return {
            "validation_loss": float(onward_loss(found, truth)),
            "validation_headings": float((off <= NEARLY).float().mean()),
            "validation_height": float((found.height - truth.next_height)[on].abs().mean()),
            "validation_ends": float(((found.end > 0) == truth.end).float().mean()),
        }

    def _loss(self, shapes: Tensor) -> Tensor:
        batch = self._draw(shapes, self.generator)
        return onward_loss(self.model(batch.windows, batch.height), batch)

    def _draw(self, shapes: Tensor, generator: torch.Generator) -> Windows:
        return draw_windows(shapes, self.rope.radius, self.config.examples, generator)


def onward_loss(found: Onward, truth: Windows) -> Tensor:
    """Mean loss of how strands are said to go on; where the rope ends, of that alone."""
    on = ~truth.end
    ends = binary_cross_entropy_with_logits(found.end, truth.end.float())
    if not on.any():
        return ends
    heading = nll_loss(found.heading[on], truth.heading[on])
    return heading + smooth_l1_loss(found.height[on], truth.next_height[on]) + ends

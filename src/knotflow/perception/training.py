"""Training the network that sees a whole rope on simulated ones (Sec. VI, [15])."""

from __future__ import annotations

import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.coarse_to_fine import CoarseToFine
from knotflow.perception.examples import Examples, draw
from knotflow.perception.network import Network
from knotflow.perception.shape_training import ShapeTraining
from knotflow.perception.supervision import crossings_right, nodes_loss, vertex_error
from knotflow.perception.training_config import TrainingConfig
from knotflow.simulation import RopeConfig

VALIDATION = 256
"""Examples that are held out, most."""


class Training(ShapeTraining):
    """A `ShapeTraining` of the network that sees a whole rope."""

    model: CoarseToFine

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
        if points.shape[1] != config.network.nodes[-1]:
            raise ValueError(
                f"the network's finest level has {config.network.nodes[-1]} nodes, so it learns "
                f"from shapes (N, {config.network.nodes[-1]}, 3); got {points.shape}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = CoarseToFine(config.network)
        super().__init__(model, points, crossings, config, seed)
        self.rope, self.config = rope, config
        apart = torch.Generator().manual_seed(seed + 1)
        order = torch.randperm(len(self._unseen), generator=apart)
        self._validation = self._draw(self._unseen[order[:VALIDATION]], apart)

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

    def _loss(self, shapes: Tensor) -> Tensor:
        batch = self._draw(shapes, self.generator)
        return nodes_loss(self.model(batch.patches), batch.nodes, self.config.loss).mean()

    def _draw(self, shapes: Tensor, generator: torch.Generator) -> Examples:
        config = self.config
        return draw(shapes, self.rope.radius, config.network.size, config.examples, generator)

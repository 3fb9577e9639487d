"""Training of both networks on simulated ropes (Sec. VI, [15])."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, nll_loss, smooth_l1_loss

from knotflow.perception.networks.network import (
    CoarseToFine,
    CoarseToFineConfig,
    Nodes,
    resample_nodes,
)
from knotflow.perception.networks.patches import (
    HEADINGS,
    WIDEST,
    Examples,
    ExamplesConfig,
    Windows,
    draw_patches,
    draw_windows,
    find_crossings,
    heights_at,
)
from knotflow.perception.networks.strands import NextStep, StrandNetwork, StrandNetworkConfig
from knotflow.simulation import RopeConfig
from knotflow.training.trainer import SupervisedTrainer

_VALIDATION = 256  # patches that are held out, most
# Weights of the losses: of the distance in the patch (half patches), the error in height (radii), a
# crossing's missing gap (radii) and the predicted distance's likelihood (a Laplace distribution).
_PLACE, _HEIGHT, _CROSSING, _SCALE = 10.0, 0.2, 1.0, 0.05
_GAP = 1.5  # radii in height between strands at a crossing that are enough; 2 is touching
_NEARLY = 0.3  # radians: a heading no further off is right, as strands that meet are further apart


@dataclass
class EffortConfig:
    """The effort of a training, and what is learned from."""

    examples: ExamplesConfig = field(default_factory=ExamplesConfig)  # how the ropes are seen
    validations: int = 100  # validations, and checkpoints, until the end
    steps: int = 200  # gradient steps between two of them
    batch: int = 48  # examples of a step
    learning_rate: float = 1e-3
    """Largest one; it rises over the first validation and falls to nothing as a cosine."""
    weight_decay: float = 1e-3  # AdamW's
    gradient_norm: float = 5.0  # gradients are cut to this length
    held_out: float = 0.05  # share of the shapes, the last ones, that are for validation


@dataclass
class TrainingConfig(EffortConfig):
    """How the network learns that sees a whole rope."""

    network: CoarseToFineConfig = field(default_factory=CoarseToFineConfig)


@dataclass
class StrandTrainingConfig(EffortConfig):
    """How the network learns that follows strands."""

    network: StrandNetworkConfig = field(default_factory=StrandNetworkConfig)
    validations: int = 25
    batch: int = 192
    learning_rate: float = 1.5e-3


def nodes_loss(found: Sequence[Nodes], truth: Tensor) -> Tensor:
    """Loss (N,) of the nodes of every level, coarse first, the finest of V nodes, against ropes
    (N, V, 3), from the nearer end. Heights are held to the truth at crossings above all, as a fit
    can hardly turn these round."""
    return torch.minimum(*(_ordered_loss(found, one) for one in (truth, truth.flip(1))))


def _ordered_loss(found: Sequence[Nodes], truth: Tensor) -> Tensor:
    total = truth.new_zeros(len(truth))
    for places, log_scale in found:
        error = places - resample_nodes(truth, places.shape[1])
        apart = (error[..., :2].square().sum(dim=-1) + 1e-8).sqrt()
        likelihood = apart.detach() * torch.exp(-log_scale) + log_scale
        each = _PLACE * apart + _HEIGHT * error[..., 2].abs()
        total = total + (each + _SCALE * likelihood).mean(dim=1)
    rope, over, under = find_crossings(truth)
    finest = found[-1].places
    missing = _GAP - (heights_at(finest, rope, over) - heights_at(finest, rope, under))
    return total.index_add(0, rope, _CROSSING * missing.clamp(min=0))


def vertex_error(places: Tensor, truth: Tensor) -> Tensor:
    """Mean distance (N,) in the patch of vertices (N, V, 3) to the truth, from the nearer end."""
    return torch.minimum(*(_mean_distance(places, one) for one in (truth, truth.flip(1))))


def _mean_distance(places: Tensor, truth: Tensor) -> Tensor:
    return (places[..., :2] - truth[..., :2]).norm(dim=-1).mean(dim=1)


def count_correct_crossings(places: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """How many crossings (N,) of ropes (N, V, 3) are the right way round, and how many there are,
    at the truth's crossings and from the nearer end."""
    turned = _mean_distance(places, truth.flip(1)) < _mean_distance(places, truth)
    nearer = torch.where(turned[:, None, None], truth.flip(1), truth)
    rope, over, under = find_crossings(nearer)
    right = (heights_at(places, rope, over) > heights_at(places, rope, under)).to(places)
    empty = places.new_zeros(len(places))
    return empty.index_add(0, rope, right), empty.index_add(0, rope, torch.ones_like(right))


def next_step_loss(found: NextStep, truth: Windows) -> Tensor:
    """Mean loss of how strands are said to go on; where the rope ends, of that alone."""
    on = ~truth.end
    ends = binary_cross_entropy_with_logits(found.end, truth.end.float())
    if not on.any():
        return ends
    heading = nll_loss(found.heading[on], truth.heading[on])
    return heading + smooth_l1_loss(found.height[on], truth.next_height[on]) + ends


class RopeTrainer(SupervisedTrainer):
    """Supervised training on simulated ropes, drawn by their number of crossings equally often."""

    network: type[nn.Module]
    """Class of what learns."""

    def __init__(
        self,
        points: NDArray,
        crossings: NDArray,
        rope: RopeConfig,
        config: TrainingConfig | StrandTrainingConfig,
        seed: int,
    ) -> None:
        """Draw the first weights and hold the last of the shapes (N, V, 3), metres, out; ones that
        come from one another stand side by side.

        Raises:
            ValueError: fewer than two shapes.
        """
        if len(points) < 2:
            raise ValueError(f"training needs shapes (N, V, 3), two or more; got {points.shape}")
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = self.network(config.network)
        super().__init__(model, config, seed)
        self.rope, self.config = rope, config
        held = max(1, round(config.held_out * len(points)))
        shapes = torch.as_tensor(np.asarray(points), dtype=torch.float32)
        self._shapes, self._unseen = shapes[:-held], shapes[-held:]
        counts = np.bincount(crossings[:-held])
        self._weights = torch.as_tensor(1.0 / counts[crossings[:-held]])
        generator = torch.Generator().manual_seed(seed + 1)
        self._validation = self.draw(self.choose_validation(generator), generator)

    def choose_validation(self, generator: torch.Generator) -> Tensor:
        """Shapes (N, V, 3) for validation, of those that are held out."""
        return self._unseen

    @abstractmethod
    def draw(self, shapes: Tensor, generator: torch.Generator) -> Any:
        """Examples of shapes (N, V, 3), metres, seen at random."""

    @abstractmethod
    def loss(self, batch: Any) -> Tensor:
        """Of a batch of examples."""

    def update(self, step: int) -> float:
        config = self.config
        chosen = torch.multinomial(
            self._weights, config.batch, replacement=True, generator=self.generator
        )
        loss = self.loss(self.draw(self._shapes[chosen], self.generator))
        warm = min(1.0, (step + 1) / config.steps)
        cosine = 0.5 * (1 + math.cos(math.pi * self.fraction(step)))
        self.descend(loss, config.learning_rate * warm * cosine)
        return float(loss.detach())


class CoarseToFineTrainer(RopeTrainer):
    """Training of the network that sees a whole rope."""

    network = CoarseToFine
    model: CoarseToFine
    config: TrainingConfig

    def choose_validation(self, generator: torch.Generator) -> Tensor:
        order = torch.randperm(len(self._unseen), generator=generator)
        return self._unseen[order[:_VALIDATION]]

    def draw(self, shapes: Tensor, generator: torch.Generator) -> Examples:
        network, examples = self.config.network, self.config.examples
        if shapes.shape[1] != network.nodes[-1]:
            raise ValueError(
                f"the network's finest level has {network.nodes[-1]} nodes, so it learns from "
                f"shapes (N, {network.nodes[-1]}, 3); got {tuple(shapes.shape)}"
            )
        return draw_patches(shapes, self.rope.radius, network.size, examples, generator)

    def loss(self, batch: Examples) -> Tensor:
        return nodes_loss(self.model(batch.patches), batch.nodes).mean()

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss, mean and median vertex error (mm), and share of crossings the right way round."""
        self.model.eval()
        patches, nodes, half = self._validation
        found = self.model(patches)
        error = 1e3 * half * vertex_error(found[-1].places, nodes)
        right, among = count_correct_crossings(found[-1].places, nodes)
        return {
            "validation_loss": float(nodes_loss(found, nodes).mean()),
            "validation_error_mm": float(error.mean()),
            "validation_median_mm": float(error.median()),
            "validation_crossings": float(right.sum() / among.sum().clamp(min=1)),
        }


class StrandTrainer(RopeTrainer):
    """Training of the network that follows strands."""

    network = StrandNetwork
    model: StrandNetwork
    config: StrandTrainingConfig

    def draw(self, shapes: Tensor, generator: torch.Generator) -> Windows:
        return draw_windows(shapes, self.rope.radius, self.config.examples, generator)

    def loss(self, batch: Windows) -> Tensor:
        return next_step_loss(self.model(batch.windows, batch.height), batch)

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

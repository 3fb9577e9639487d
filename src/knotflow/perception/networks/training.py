"""Training of both networks on simulated ropes, and of one on images alone (Sec. VI, [15])."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, nll_loss, smooth_l1_loss

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.segmentation import pixel_coverage, segment
from knotflow.perception.networks.config import (
    SELF_SUPERVISION_STEPS,
    EffortConfig,
    LossConfig,
    StrandTrainingConfig,
    TrainingConfig,
)
from knotflow.perception.networks.examples import (
    Examples,
    Windows,
    draw_patches,
    draw_windows,
    find_crossings,
    heights_at,
)
from knotflow.perception.networks.models import (
    HEADINGS,
    WIDEST,
    CoarseToFine,
    NextStep,
    Nodes,
    StrandNetwork,
    resample_nodes,
)
from knotflow.perception.networks.network import Network
from knotflow.perception.networks.patches import FLIPS, crop_rope, mirrored
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread
from knotflow.training.trainer import SupervisedTrainer

VALIDATION = 256
"""Patches that are held out, most."""
NEARLY = 0.3
"""A heading that is no further off is right, radians: strands that meet are further apart."""


def nodes_loss(found: Sequence[Nodes], truth: Tensor, config: LossConfig | None = None) -> Tensor:
    """Loss (N,) of the nodes of every level, coarse first, against ropes (N, V, 3), from the nearer
    end. The finest level has V nodes.

    Heights are held to the truth at crossings above all, as a fit can hardly turn these round.
    """
    config = config or LossConfig()
    orders = [_ordered_loss(found, one, config) for one in (truth, truth.flip(1))]
    return torch.minimum(*orders)


def _ordered_loss(found: Sequence[Nodes], truth: Tensor, config: LossConfig) -> Tensor:
    total = truth.new_zeros(len(truth))
    for places, log_scale in found:
        error = places - resample_nodes(truth, places.shape[1])
        apart = (error[..., :2].square().sum(dim=-1) + 1e-8).sqrt()
        likelihood = apart.detach() * torch.exp(-log_scale) + log_scale
        each = config.place * apart + config.height * error[..., 2].abs()
        total = total + (each + config.scale * likelihood).mean(dim=1)
    rope, over, under = find_crossings(truth)
    finest = found[-1].places
    missing = config.gap - (heights_at(finest, rope, over) - heights_at(finest, rope, under))
    return total.index_add(0, rope, config.crossing * missing.clamp(min=0))


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

    def __init__(
        self, model: nn.Module, points: NDArray, crossings: NDArray, config: EffortConfig, seed: int
    ) -> None:
        """Hold the last shapes out.

        Args:
            model: that learns.
            points: (N, V, 3) shapes at rest, metres; ones that come from one another side by side.
            crossings: (N,) number of each shape.
            config: the effort.
            seed: of everything random.

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
        self._batch, self._warm_up, self._highest = config.batch, config.steps, config.learning_rate

    @abstractmethod
    def loss(self, shapes: Tensor) -> Tensor:
        """Of a batch of shapes (N, V, 3), metres, seen at random."""

    def update(self, step: int) -> float:
        chosen = torch.multinomial(
            self._weights, self._batch, replacement=True, generator=self.generator
        )
        loss = self.loss(self._shapes[chosen])
        warm = min(1.0, (step + 1) / self._warm_up)
        cosine = 0.5 * (1 + math.cos(math.pi * self.fraction(step)))
        self.descend(loss, self._highest * warm * cosine)
        return float(loss.detach())


class CoarseToFineTrainer(RopeTrainer):
    """Training of the network that sees a whole rope."""

    model: CoarseToFine

    def __init__(
        self,
        points: NDArray,
        crossings: NDArray,
        rope: RopeConfig,
        config: TrainingConfig,
        seed: int,
    ) -> None:
        """Draw the first weights from `seed`; arguments as those of `RopeTrainer`.

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
        generator = torch.Generator().manual_seed(seed + 1)
        order = torch.randperm(len(self._unseen), generator=generator)
        self._validation = self._draw(self._unseen[order[:VALIDATION]], generator)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Loss, mean and median vertex error (mm), and share of crossings the right way round."""
        self.model.eval()
        patches, nodes, half = self._validation
        found = self.model(patches)
        error = 1e3 * half * vertex_error(found[-1].places, nodes)
        right, among = count_correct_crossings(found[-1].places, nodes)
        return {
            "validation_loss": float(nodes_loss(found, nodes, self.config.loss).mean()),
            "validation_error_mm": float(error.mean()),
            "validation_median_mm": float(error.median()),
            "validation_crossings": float(right.sum() / among.sum().clamp(min=1)),
        }

    def loss(self, shapes: Tensor) -> Tensor:
        batch = self._draw(shapes, self.generator)
        return nodes_loss(self.model(batch.patches), batch.nodes, self.config.loss).mean()

    def _draw(self, shapes: Tensor, generator: torch.Generator) -> Examples:
        size, examples = self.config.network.size, self.config.examples
        return draw_patches(shapes, self.rope.radius, size, examples, generator)


class StrandTrainer(RopeTrainer):
    """Training of the network that follows strands."""

    model: StrandNetwork

    def __init__(
        self,
        points: NDArray,
        crossings: NDArray,
        rope: RopeConfig,
        config: StrandTrainingConfig,
        seed: int,
    ) -> None:
        """Draw the first weights from `seed`; arguments as those of `RopeTrainer`."""
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
            "validation_loss": float(next_step_loss(found, truth)),
            "validation_headings": float((off <= NEARLY).float().mean()),
            "validation_height": float((found.height - truth.next_height)[on].abs().mean()),
            "validation_ends": float(((found.end > 0) == truth.end).float().mean()),
        }

    def loss(self, shapes: Tensor) -> Tensor:
        batch = self._draw(shapes, self.generator)
        return next_step_loss(self.model(batch.windows, batch.height), batch)

    def _draw(self, shapes: Tensor, generator: torch.Generator) -> Windows:
        return draw_windows(shapes, self.rope.radius, self.config.examples, generator)


@dataclass
class SelfSupervisionConfig:
    """The effort of `SelfSupervision`."""

    steps: int = SELF_SUPERVISION_STEPS
    """Gradient steps."""
    batch: int = 16
    """Images of a step, each in one of the patch's mirror images."""
    learning_rate: float = 1e-4
    """AdamW's first one; it falls to nothing as a cosine."""
    loss: LossConfig = field(default_factory=LossConfig)
    """What counts, as in training."""


class SelfSupervision:
    """Training of a network, in place, on images alone: it learns to guess their estimates.

    [15] descends the rendering's loss itself, which draws a guess to the nearest shape that covers
    the rope; estimates that are not ambiguous are nearer to the truth. Iterating over it gives each
    step's loss.
    """

    def __init__(
        self,
        network: Network,
        images: Sequence[RgbdImage],
        shapes: Sequence[NDArray],
        camera: Camera,
        rope: RopeConfig,
        config: SelfSupervisionConfig | None = None,
        seed: int = 0,
    ) -> None:
        """Crop the images.

        Args:
            network: its model of whole ropes learns, which has as many nodes as the rope vertices.
            images: of this camera, each of one rope.
            shapes: (V, 3) metres, the estimate of each image; leave ambiguous ones out.
            camera: that took them.
            rope: its length, radius and number of links.
            config: the effort.
            seed: of the order of the images.

        Raises:
            ValueError: no images, another number of shapes, or a rope of another number of
                vertices.
            TraceError: an image without rope.
        """
        nodes = network.model.config.nodes[-1]
        if not images or len(images) != len(shapes) or rope.num_vertices != nodes:
            raise ValueError(
                f"self-supervision needs an image or more, a shape for each, and a rope of {nodes} "
                f"vertices as the network has; got {len(images)} images, {len(shapes)} shapes and "
                f"{rope.num_vertices} vertices"
            )
        self.network = network
        self.config = config or SelfSupervisionConfig()
        self._rng = np.random.default_rng(seed)
        size = network.model.config.size
        crops: list[Tensor] = []
        targets: list[NDArray] = []
        for image, shape in zip(images, shapes, strict=True):
            segmentation = segment(image, camera, rope.radius)
            share = pixel_coverage(image, segmentation)
            patch, crop = crop_rope(segmentation, share, camera, rope, size)
            crops += mirrored(torch.as_tensor(crop))
            targets += [patch.flipped(*flip).from_world(shape, camera) for flip in FLIPS]
        self._crops = torch.stack(crops)
        self._nodes = torch.as_tensor(np.stack(targets), dtype=torch.float32)
        parameters = network.model.parameters()
        self._optimizer = torch.optim.AdamW(parameters, self.config.learning_rate)
        self._schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
            self._optimizer, self.config.steps
        )

    def __iter__(self) -> Iterator[float]:
        # Batch normalisation keeps its statistics: a few images would give worse ones.
        self.network.model.eval()
        for _ in range(self.config.steps):
            yield self._step()

    @one_thread()
    def _step(self) -> float:
        model, config = self.network.model, self.config
        chosen = self._rng.integers(len(self._crops), size=config.batch)
        loss = nodes_loss(model(self._crops[chosen]), self._nodes[chosen], config.loss).mean()
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        self._optimizer.step()
        self._schedule.step()
        return float(loss.detach())

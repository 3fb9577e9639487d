"""A network goes on learning from images alone, by what the whole method makes of them (Sec. VI).

Nobody knows the true shape of a rope in a real image. But where first guesses, their rearrangement
and the fit to the image leave nothing in doubt, the estimate is nearer to the truth than the
network's own guess; so the network learns to guess it. This is less than [15] asks of images: the
rendering's loss by itself, without a search, draws a guess to the nearest shape that covers the
rope, with strands that are mixed up, and networks got worse by it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera import Camera
from knotflow.perception.image import RgbdImage
from knotflow.perception.network import FLIPS, Network, look, mirrored
from knotflow.perception.segmentation import segment
from knotflow.perception.supervision import nodes_loss
from knotflow.perception.training_config import SELF_SUPERVISION_STEPS, LossConfig
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread


@dataclass
class SelfSupervisionConfig:
    """The effort."""

    steps: int = SELF_SUPERVISION_STEPS
    """Gradient steps."""
    batch: int = 16
    """Images of a step, each in one of the patch's mirror images."""
    learning_rate: float = 1e-4
    """AdamW's first one; it falls to nothing as a cosine."""
    loss: LossConfig = field(default_factory=LossConfig)
    """What counts, as in training."""


class SelfSupervision:
    """Goes on training a network, in place; iterating over it gives each step's loss."""

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
        """Segments the images.

        Args:
            network: whose model of whole ropes learns; its nodes are as many as the rope's
                vertices.
            images: of this camera, each of one rope.
            shapes: (V, 3) metres, of each image's rope as it was estimated. Leave doubtful
                estimates out, and their images.
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
            patch, crop = look(segmentation, coverage(image, segmentation), camera, rope, size)
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

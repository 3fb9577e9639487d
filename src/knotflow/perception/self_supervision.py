"""A network goes on learning from images alone, through the renderer (Sec. VI; [15]'s point).

Nobody knows the true shape of a rope in a real image, but a shape that is right accounts for the
image. So the losses of the fit, on silhouette, depth and the rope's own length, teach the network.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from knotflow.perception.camera import Camera
from knotflow.perception.fitting import FitConfig, image_loss, shape_loss
from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.losses import Target
from knotflow.perception.network import FLIPS, Network, look
from knotflow.perception.patch import Patch
from knotflow.perception.segmentation import segment
from knotflow.perception.training_config import SELF_SUPERVISION_STEPS
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread


@dataclass
class SelfSupervisionConfig:
    """The effort."""

    steps: int = SELF_SUPERVISION_STEPS
    """Gradient steps."""
    batch: int = 8
    """Images of a step; a gradient costs about 10 ms an image."""
    learning_rate: float = 1e-4
    """Of Adam."""
    softness: float = 8e-3
    """Softness of the rendering, metres: a gradient reaches five times as far."""
    fit: FitConfig = field(default_factory=FitConfig)
    """Weights of the losses."""


class _Unlabelled(NamedTuple):
    patch: Patch
    crop: Tensor
    target: Target


class SelfSupervision:
    """Goes on training a network, in place; iterating over it gives each step's loss."""

    def __init__(
        self,
        network: Network,
        images: Sequence[RgbdImage],
        camera: Camera,
        rope: RopeConfig,
        config: SelfSupervisionConfig | None = None,
        seed: int = 0,
    ) -> None:
        """Segments the images.

        Args:
            network: that learns; its nodes are as many as the rope's vertices.
            images: of this camera, each of one rope, whose shapes nobody knows.
            camera: that took them.
            rope: its length, radius and number of links.
            config: the effort.
            seed: of the order of the images.

        Raises:
            ValueError: no images, or a rope of another number of vertices.
            TraceError: an image without rope.
        """
        nodes = network.model.config.nodes[-1]
        if not images or rope.num_vertices != nodes:
            raise ValueError(
                f"self-supervision needs an image or more, and a rope of {nodes} vertices as the "
                f"network has; got {len(images)} images and {rope.num_vertices} vertices"
            )
        self.network, self.camera, self.rope = network, camera, rope
        self.config = config or SelfSupervisionConfig()
        self._rng = np.random.default_rng(seed)
        self._images = [self._seen(one) for one in images]
        self._optimizer = torch.optim.Adam(network.model.parameters(), self.config.learning_rate)

    def __iter__(self) -> Iterator[float]:
        # Batch normalisation keeps its statistics: a few images would give worse ones.
        self.network.model.eval()
        for _ in range(self.config.steps):
            yield self._step()

    @one_thread()
    def _step(self) -> float:
        config = self.config
        chosen = [self._images[i] for i in self._rng.integers(len(self._images), size=config.batch)]
        flips = [FLIPS[i] for i in self._rng.integers(len(FLIPS), size=config.batch)]
        crops = [
            one.crop.flip([axis for axis, sign in zip((2, 1), flip, strict=True) if sign < 0])
            for one, flip in zip(chosen, flips, strict=True)
        ]
        nodes = self.network.model(torch.stack(crops))[-1].places.double()
        losses = []
        for one, flip, places in zip(chosen, flips, nodes, strict=True):
            shape = one.patch.flipped(*flip).lift(places, self.camera)
            losses.append(
                image_loss(shape, one.target, self.camera, self.rope, config.fit, config.softness)
                + shape_loss(shape, self.rope, config.fit)
            )
        loss = torch.stack(losses).mean()
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.model.parameters(), 1.0)
        self._optimizer.step()
        return float(loss.detach())

    def _seen(self, image: RgbdImage) -> _Unlabelled:
        segmentation = segment(image, self.camera, self.rope.radius)
        share = coverage(image, segmentation)
        size = self.network.model.config.size
        patch, crop = look(segmentation, share, self.camera, self.rope, size)
        known = segmentation.rope | (segmentation.labels == Label.TABLE)
        depth = np.where(known, image.depth, np.nan)
        target = Target.of(segmentation.rope, known, depth, share)
        return _Unlabelled(patch, torch.as_tensor(crop), target)

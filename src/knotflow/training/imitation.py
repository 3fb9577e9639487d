"""Imitation: a primitive learns from demonstrations alone (Sec. V-B a and b).

"The replay buffer is initially populated with demonstration data, and this training stage will be
referred to as imitation learning." Held-out losses are measured and decide nothing: the last
weights count.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.simulation import Trials
from knotflow.training.config import ImitationConfig
from knotflow.training.learner import Learner, demonstration_buffer
from knotflow.training.trainer import Metrics, Trainer

FEW_STARTS = 4
"""With fewer start shapes none can be spared, and trials are held out instead."""


class Imitation(Trainer):
    """Trains `primitive` on demonstrations; a round ends with a validation."""

    def __init__(
        self,
        trials: Sequence[Sequence[Trials]],
        primitive: PrimitiveConfig,
        config: ImitationConfig,
        seed: int,
    ) -> None:
        """Draws the primitive's first weights, and what is held out, from `seed`.

        Args:
            trials: for each action of this primitive, trials of one rope each.
            primitive: what it is made of.
            config: the effort.
            seed: of everything random.

        Raises:
            ValueError: there are no trials.
        """
        super().__init__(config.validations)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.primitive = Primitive(primitive)
        self.config = config
        self.learner = Learner(self.primitive, config.learner, seed)
        rng = np.random.default_rng(seed)
        learned, held_out = [], []
        for some in trials:
            for one, held in zip(some, _held_out(some, config.held_out, rng), strict=True):
                learned.append(one[~held])
                held_out.append(one[held])
        generator = self.learner.generator
        self.learner.demonstrations = demonstration_buffer(learned, generator)
        unseen = demonstration_buffer(held_out, generator)
        self._validation = unseen.sample(len(unseen), unseen.slots)

    def step(self) -> Metrics:
        self.primitive.train()
        return self.learner.fit(self.config.steps)

    @torch.no_grad()
    def validate(self) -> Metrics:
        """Losses on the held-out trials."""
        measured = self.learner.measure(self._validation)
        return {f"validation_{key}": float(value) for key, value in measured.items()}

    def state_dict(self) -> dict[str, Any]:
        return super().state_dict() | {"learner": self.learner.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        super().load_state_dict(state)
        self.learner.load_state_dict(state["learner"])


def _held_out(trials: Sequence[Trials], share: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Which trials (N,) of each rope are held out."""
    sizes = [len(one) for one in trials]
    if len(trials) < FEW_STARTS:
        held = rng.random(sum(sizes)) < share
        if not held.any():  # of a few trials, as of a person's first demonstration
            held[rng.integers(len(held))] = True
        return np.split(held, np.cumsum(sizes)[:-1])
    ropes = rng.permutation(len(trials))[: max(1, round(share * len(trials)))]
    return [np.full(size, number in ropes) for number, size in enumerate(sizes)]

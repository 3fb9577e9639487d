"""Imitation: a primitive learns from demonstrations alone (Sec. V-B a and b).

"The replay buffer is initially populated with demonstration data, and this training stage will be
referred to as imitation learning." What is held out is measured and decides nothing: a handful of
start shapes, by whose losses training would end almost before it began, says little of how often
splines succeed. On primitive 4, weights of the best held-out losses made C(2,0,1) in 3 % of trials
and the last ones in 30 %.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch

from knotflow.samplers.demonstrations import Trials
from knotflow.samplers.primitives.primitive import Primitive, PrimitiveConfig
from knotflow.training.config import ImitationConfig
from knotflow.training.fitting import fit
from knotflow.training.learner import Learner, demonstration_buffer
from knotflow.training.resumable import Resumable

FEW_STARTS = 4
"""With fewer start shapes than that none can be spared, and trials are held out instead."""


class Imitation(Resumable):
    """Training on demonstrations; iterating over it trains, and gives metrics per validation.

        for metrics in training:
            training.save(folder)
        primitive = training.primitive

    The same arguments give the same weights on one machine. It may be interrupted after any item,
    and goes on from what was saved.
    """

    def __init__(
        self,
        trials: Sequence[Trials],
        primitive: PrimitiveConfig,
        config: ImitationConfig,
        seed: int,
    ) -> None:
        """Draws the primitive's first weights, and what is held out, from `seed`.

        Args:
            trials: of the actions of this primitive, one item an action.
            primitive: what it is made of.
            config: the effort to spend.
            seed: everything random comes from it.

        Raises:
            ValueError: there are no trials.
        """
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.primitive = Primitive(primitive)
        self.config = config
        self.learner = Learner(self.primitive, config.learner, seed)
        rng = np.random.default_rng(seed)
        held = [_held_out(some, config.held_out, rng) for some in trials]
        generator = self.learner.generator
        self.learner.demonstrations = demonstration_buffer(
            [(some, ~out) for some, out in zip(trials, held, strict=True)], generator
        )
        unseen = demonstration_buffer(list(zip(trials, held, strict=True)), generator)
        self._validation = unseen.sample(len(unseen), unseen.slots)
        self._done = 0

    def __iter__(self) -> Iterator[dict[str, float]]:
        while self._done < self.config.validations:
            self.primitive.train()
            metrics = fit(self.learner, self.config.steps)
            self._done += 1
            yield metrics | self._validate()

    @property
    def steps(self) -> int:
        """Gradient steps made so far."""
        return self._done * self.config.steps

    def state_dict(self) -> dict[str, Any]:
        return {"learner": self.learner.state_dict(), "done": self._done}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.learner.load_state_dict(state["learner"])
        self._done = state["done"]

    @torch.no_grad()
    def _validate(self) -> dict[str, float]:
        metrics: dict[str, float] = {}
        for loss in self.learner.losses:
            for key, value in loss(self._validation).items():
                metrics[f"validation_{key}"] = float(value)
        return metrics


def _held_out(trials: Trials, share: float, rng: np.random.Generator) -> np.ndarray:
    """Which trials (N,) are held out."""
    if len(trials.starts) < FEW_STARTS:
        held = rng.random(len(trials)) < share
        if not held.any():  # of a few trials, as of a person's first demonstration
            held[rng.integers(len(trials))] = True
        return held
    count = max(1, round(share * len(trials.starts)))
    return np.isin(trials.start, rng.permutation(len(trials.starts))[:count])

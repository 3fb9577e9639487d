"""Training of Causal InfoGAN (Sec. VII-C).

For pairs (x, x') of the data, c uniform, c' from the transition, and (y, y') = G(z, c, c'):

    D:        min  -log D(x, x') - log(1 - D(y, y'))
    G, Q, T:  min  -log D(y, y') - 0.1 [I(c; y) + I(c'; y' | c)] + 0.1 E |var T(c)|^2

where the information is bounded from below with Q (Kurutach et al. 2018, Eq. 4).
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import softplus

from knotflow.samplers.causal_infogan.data import CausalInfoGanConfig
from knotflow.samplers.causal_infogan.networks import (
    CausalInfoGan,
    Checkup,
    Scale,
    gaussian_log_density,
)
from knotflow.training.trainer import Metrics, Trainer

LEARNING_RATE, BETAS = 2e-4, (0.5, 0.999)
"""Adam's, for all networks; as the authors'."""
INFORMATION_WEIGHT = 0.1
"""Weight of the mutual information between codes and shapes."""
VARIANCE_WEIGHT = 0.1
"""Weight of the transition's squared variance, which keeps steps of a plan small."""


class CausalInfoGanTrainer(Trainer):
    """Trains `model`; a round ends with a check of the generator's health."""

    def __init__(
        self,
        shapes: NDArray[np.float64],
        starts: NDArray[np.intp],
        config: CausalInfoGanConfig,
        seed: int,
    ) -> None:
        """Shapes (N, F, V, 3) of F >= 2 frames in their start frames, metres; starts (N,)."""
        super().__init__(math.ceil(config.steps / config.check_every))
        self.config = config
        self._shapes = torch.as_tensor(shapes, dtype=torch.float32)
        self._rng = torch.Generator().manual_seed(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            scale = Scale.of(self._shapes[:, :-1].flatten(0, 1), self._shapes[:, 1:].flatten(0, 1))
            self.model = CausalInfoGan(config, scale, shapes.shape[2])
        self._checkup = Checkup(self._shapes, torch.as_tensor(starts))
        model = self.model
        self._critic = torch.optim.Adam(model.discriminator.parameters(), LEARNING_RATE, BETAS)
        makers = (model.generator, model.posterior, model.transition)
        made = [parameter for one in makers for parameter in one.parameters()]
        self._maker = torch.optim.Adam(made, LEARNING_RATE, BETAS)

    def step(self) -> Metrics:
        first = len(self.history) * self.config.check_every
        last = min(first + self.config.check_every, self.config.steps)
        self.model.train()
        losses = [self._update() for _ in range(first, last)]
        means = {name: float(np.mean([one[name] for one in losses])) for name in losses[0]}
        return {"step": last} | means

    def validate(self) -> Metrics:
        return asdict(self._checkup(self.model))

    @property
    def parts(self) -> dict[str, Any]:
        optimizers = {"critic": self._critic, "maker": self._maker}
        return {"model": self.model, **optimizers, "rng": self._rng}

    def _update(self) -> dict[str, float]:
        config, model = self.config, self.model
        rollouts, frames = self._shapes.shape[:2]
        rollout = torch.randint(rollouts, (config.batch,), generator=self._rng)
        frame = torch.randint(frames - 1, (config.batch,), generator=self._rng)
        first, second = self._shapes[rollout, frame], self._shapes[rollout, frame + 1]
        noise, code, next_code, variance = model.draw(config.batch, self._rng)
        made, next_made = model.generator(noise, code, next_code)

        odds = model.discriminator(
            torch.cat([first, made.detach()]), torch.cat([second, next_made.detach()])
        )
        real, fake = odds.split(config.batch)
        critic_loss = softplus(-real).mean() + softplus(fake).mean()
        self._critic.zero_grad()
        torch.autograd.backward(critic_loss)
        self._critic.step()

        model.discriminator.requires_grad_(False)
        fooled = softplus(-model.discriminator(made, next_made)).mean()
        mean, spread = model.posterior(torch.cat([made, next_made]))
        codes = torch.cat([code, next_code])
        # The entropy of the prior is a constant; that of the transition is not.
        unknown = 2 * -gaussian_log_density(codes, mean, spread).mean()
        unknown = unknown + gaussian_log_density(next_code, code, variance).mean()
        wide = (variance**2).sum(dim=1).mean()
        loss = fooled + INFORMATION_WEIGHT * unknown + VARIANCE_WEIGHT * wide
        self._maker.zero_grad()
        torch.autograd.backward(loss)
        self._maker.step()
        model.discriminator.requires_grad_(True)
        return {
            "discriminator_loss": critic_loss.item(),
            "generator_loss": fooled.item(),
            "information_loss": unknown.item(),
            "transition_deviation": variance.sqrt().mean().item(),
        }

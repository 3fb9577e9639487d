"""Training: the generative-adversarial game with the mutual information of codes and shapes.

For pairs (x, x') of the data, c uniform, c' from the transition, and (y, y') = G(z, c, c'):

    D:        min  -log D(x, x') - log(1 - D(y, y'))
    G, Q, T:  min  -log D(y, y') - 0.1 [I(c; y) + I(c'; y' | c)] + 0.1 E |var T(c)|^2

where the information is bounded from below with Q (Kurutach et al. 2018, Eq. 4).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import softplus

from knotflow.samplers.causal_infogan.config import CausalInfoGanConfig
from knotflow.samplers.causal_infogan.networks import CausalInfoGan, Scale, gaussian_log_density


class Trainer:
    """A model in training. The same shapes, configuration and seed give the same model.

    Args:
        shapes: (N, F, V, 3) N rollouts of F frames each in their start frames, metres.
        config: networks and training.
        seed: of the first weights and everything random.
    """

    def __init__(self, shapes: NDArray, config: CausalInfoGanConfig, seed: int) -> None:
        if shapes.ndim != 4 or shapes.shape[-1] != 3 or len(shapes) == 0 or shapes.shape[1] < 2:
            raise ValueError(
                "training shapes are (N, F, V, 3) with at least one rollout of two frames, "
                f"got {shapes.shape}"
            )
        self.config, self.step = config, 0
        self._shapes = torch.as_tensor(shapes, dtype=torch.float32)
        self._rng = torch.Generator().manual_seed(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            scale = Scale.of(self._shapes[:, :-1].flatten(0, 1), self._shapes[:, 1:].flatten(0, 1))
            self.model = CausalInfoGan(config, scale, shapes.shape[2])
        model, betas = self.model, (config.beta1, config.beta2)
        self._critic = torch.optim.Adam(
            model.discriminator.parameters(), config.learning_rate, betas
        )
        makers = (model.generator, model.posterior, model.transition)
        self._maker = torch.optim.Adam(
            [parameter for one in makers for parameter in one.parameters()],
            config.learning_rate,
            betas,
        )

    def advance(self, steps: int) -> dict[str, float]:
        """Take gradient steps; means of the losses over them."""
        self.model.train()
        losses = [self._update() for _ in range(steps)]
        self.step += steps
        return {name: float(np.mean([one[name] for one in losses])) for name in losses[0]}

    def state_dict(self) -> dict[str, Any]:
        """Everything needed to go on, exactly as if never interrupted."""
        return {
            "step": self.step,
            "model": self.model.state_dict(),
            "critic": self._critic.state_dict(),
            "maker": self._maker.state_dict(),
            "rng": self._rng.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from what `state_dict` gave."""
        self.step = state["step"]
        self.model.load_state_dict(state["model"])
        self._critic.load_state_dict(state["critic"])
        self._maker.load_state_dict(state["maker"])
        self._rng.set_state(state["rng"])

    def _pairs(self) -> tuple[Tensor, Tensor]:
        rollouts, frames = self._shapes.shape[:2]
        rollout = torch.randint(rollouts, (self.config.batch,), generator=self._rng)
        frame = torch.randint(frames - 1, (self.config.batch,), generator=self._rng)
        return self._shapes[rollout, frame], self._shapes[rollout, frame + 1]

    def _update(self) -> dict[str, float]:
        config, model = self.config, self.model
        first, second = self._pairs()
        noise, code, next_code, variance = model.draw(config.batch, self._rng)
        made, next_made = model.generator(noise, code, next_code)

        odds = model.discriminator(
            torch.cat([first, made.detach()]), torch.cat([second, next_made.detach()])
        )
        real, fake = odds.split(config.batch)
        critic_loss = softplus(-real).mean() + softplus(fake).mean()
        self._critic.zero_grad()
        critic_loss.backward()
        self._critic.step()

        for parameter in model.discriminator.parameters():
            parameter.requires_grad_(False)
        fooled = softplus(-model.discriminator(made, next_made)).mean()
        mean, spread = model.posterior(torch.cat([made, next_made]))
        codes = torch.cat([code, next_code])
        # The entropy of the prior is a constant; that of the transition is not.
        unknown = 2 * -gaussian_log_density(codes, mean, spread).mean()
        unknown = unknown + gaussian_log_density(next_code, code, variance).mean()
        wide = (variance**2).sum(dim=1).mean()
        loss = fooled + config.information_weight * unknown + config.variance_weight * wide
        self._maker.zero_grad()
        loss.backward()
        self._maker.step()
        for parameter in model.discriminator.parameters():
            parameter.requires_grad_(True)
        return {
            "discriminator_loss": critic_loss.item(),
            "generator_loss": fooled.item(),
            "information_loss": unknown.item(),
            "transition_deviation": variance.sqrt().mean().item(),
        }

"""Planning: project the given shapes, go straight through the latent space, decode (Sec. VII-C).

As in the reference code: a start is projected onto the first shape of generated pairs, a goal onto
the second; of many noises the plan is kept whose pairs the discriminator finds most probable. Codes
stay in the prior's range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from knotflow.samplers.causal_infogan.data import NOISE_DIM, StartFrame
from knotflow.samplers.causal_infogan.networks import CausalInfoGan
from knotflow.topology.polyline import Floats

MAX_NOISE = 3.0
"""Deviations."""
PROJECTION_RATE = 0.02
"""Adam's rate in a projection."""


@dataclass(frozen=True)
class Plans:
    """Plans for B pairs of given shapes; metres, world frame."""

    projected_start: Floats  # (B, V, 3) the generated shape nearest to the given start
    way_points: Floats  # (B, steps + 1, V, 3) decoded from the line between the projections' codes
    projected_end: Floats  # (B, V, 3) the generated shape nearest to the given end


class Planner:
    """Plans of rope shapes from a trained model, which is frozen.

    A plan depends on the seed and on the batch it is made in.
    """

    def __init__(self, model: CausalInfoGan, seed: int) -> None:
        self.model = model.eval().requires_grad_(False)
        self._rng = torch.Generator().manual_seed(seed)

    def plan(self, starts: Floats, ends: Floats, steps: int) -> Plans:
        """Plans from start to end shapes of the model's rope, (B, V, 3), metres, world frame."""
        starts, ends = np.asarray(starts, float), np.asarray(ends, float)
        frame = StartFrame.of(starts)
        first, code = self.project(torch.from_numpy(frame.enter(starts)).float(), second=False)
        last, goal = self.project(torch.from_numpy(frame.enter(ends)).float(), second=True)
        pairs = zip(code, goal, strict=True)
        between = torch.stack([self._interpolate(one, other, steps) for one, other in pairs])
        return Plans(*(frame.leave(part.double().numpy()) for part in (first, between, last)))

    def project(self, targets: Tensor, *, second: bool) -> tuple[Tensor, Tensor]:
        """Nearest generated shapes (B, V, 3), as first or second of a pair, and their codes.

        Targets (B, V, 3) are in start frames, metres.
        """
        config, model = self.model.config, self.model
        with torch.no_grad():
            drawn = model.draw(config.prior_samples, self._rng)[:3]
            made = model.generator(*drawn)[second]
            distance = torch.cdist(targets.flatten(1), made.flatten(1))
        best = distance.topk(config.restarts, largest=False).indices.flatten()
        noise, code, next_code = (one[best].clone() for one in drawn)
        # The step between the codes, in units of the transition's deviation, stays as drawn.
        with torch.no_grad():
            step = (next_code - code) / model.transition(code, torch.zeros_like(code))[1].sqrt()
        wanted = targets.repeat_interleave(config.restarts, dim=0)
        optimizer = torch.optim.Adam(
            [noise.requires_grad_(), code.requires_grad_()], PROJECTION_RATE
        )
        for _ in range(config.projection_steps):
            made = model.generator(noise, code, model.transition(code, step)[0])[second]
            loss = (made - wanted).square().sum() / model.scale.spread.square().sum()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            with torch.no_grad():
                noise.clamp_(-MAX_NOISE, MAX_NOISE)
                code.clamp_(-1, 1)
        with torch.no_grad():
            next_code = model.transition(code, step)[0]
            made = model.generator(noise, code, next_code)[second]
            error = (made - wanted).square().sum(dim=(1, 2)).view(-1, config.restarts)
        best = error.argmin(dim=1) + config.restarts * torch.arange(len(targets))
        return made[best], (next_code if second else code)[best].detach()

    @torch.no_grad()
    def _interpolate(self, start: Tensor, goal: Tensor, steps: int) -> Tensor:
        """Way points (steps + 1, V, 3) between two codes (code_dim,)."""
        model, count = self.model, self.model.config.candidates
        along = torch.linspace(0, 1, steps + 1)[:, None]
        codes = start + (goal - start) * along
        noise = torch.randn(count, NOISE_DIM, generator=self._rng)
        current = codes[:-1].repeat(count, 1)
        following = codes[1:].repeat(count, 1)
        pairs = model.generator(noise.repeat_interleave(steps, dim=0), current, following)
        first, second = (one.view(count, steps, *one.shape[1:]) for one in pairs)
        plans = torch.cat([first[:, :1], second], dim=1)
        belief = model.discriminator(plans[:, :-1].flatten(0, 1), plans[:, 1:].flatten(0, 1))
        return plans[belief.sigmoid().view(count, steps).mean(dim=1).argmax()]

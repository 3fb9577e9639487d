"""Whether a training has collapsed, judged by what the generator makes.

Three ways to fail are distinguished, each as a number that is near 1 for a healthy model:

- spread: the mean distance between two generated shapes over that between two shapes of the data.
  Mode collapse makes all shapes alike, and brings it to 0.
- starts_covered: generated shapes are put down to the demonstrated start of the nearest shape of
  the data; the effective number of starts (exponential of the entropy) over that of the data.
  A generator that left out half of the demonstrated configurations has 0.5.
- code_used: the share of the codes' variance that the posterior reads back off generated shapes.
  At 0 the shapes say nothing of the code, and a plan through the codes stays at one shape.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import torch
from torch import Tensor

from knotflow.samplers.causal_infogan.networks import CausalInfoGan

LEAST = {"spread": 0.5, "starts_covered": 0.5, "code_used": 0.25}
"""A training whose numbers end below one of these has collapsed."""
SAMPLES = 1000


@dataclass(frozen=True)
class Health:
    """A point of the training curves; distances are root mean squares over vertices, metres."""

    spread: float
    starts_covered: float
    code_used: float
    distance_to_data: float
    """From a generated shape to the nearest of the data, mean: how plausible shapes are."""
    distance_from_data: float
    """From a shape of the data to the nearest generated, mean: what is left out."""
    motion: float
    """Mean motion from the first to the second shape of a pair, over that of the data."""

    @property
    def collapsed(self) -> list[str]:
        """The numbers that indicate a collapse; none for a healthy model."""
        numbers = asdict(self)
        return [name for name, least in LEAST.items() if not numbers[name] >= least]


class Checkup:
    """Compares a generator with a fixed sample of the data.

    Args:
        shapes: (N, F, V, 3) the training shapes, start frames, metres.
        starts: (N,) number of the demonstrated start of each rollout.
        seed: of the samples; the same for all models, so that curves can be compared.
    """

    def __init__(self, shapes: Tensor, starts: Tensor, seed: int = 0) -> None:
        self._seed = seed
        rng = torch.Generator().manual_seed(seed)
        rollout = torch.randint(len(shapes), (SAMPLES,), generator=rng)
        frame = torch.randint(shapes.shape[1] - 1, (SAMPLES,), generator=rng)
        self._data = shapes[rollout, frame]
        self._starts = torch.unique(starts, return_inverse=True)[1][rollout]
        self._motion = _rms(shapes[rollout, frame + 1] - self._data).mean()
        self._spread = _between(self._data)
        self._effective = _effective(self._starts)

    @torch.no_grad()
    def __call__(self, model: CausalInfoGan) -> Health:
        """The model's health, on samples of the prior."""
        was_training = model.training
        model.eval()
        noise, code, next_code, _ = model.draw(SAMPLES, torch.Generator().manual_seed(self._seed))
        made, next_made = model.generator(noise, code, next_code)
        read, _ = model.posterior(made)
        model.train(was_training)
        distance = _distances(made, self._data)
        nearest = self._starts[distance.argmin(dim=1)]
        unread = (read - code).square().mean() / code.var()
        return Health(
            spread=float(_between(made) / self._spread),
            starts_covered=_effective(nearest) / self._effective,
            code_used=float(1 - unread),
            distance_to_data=float(distance.amin(dim=1).mean()),
            distance_from_data=float(distance.amin(dim=0).mean()),
            motion=float(_rms(next_made - made).mean() / self._motion),
        )


def _rms(difference: Tensor) -> Tensor:
    return difference.square().sum(dim=-1).mean(dim=-1).sqrt()


def _distances(one: Tensor, other: Tensor) -> Tensor:
    return torch.cdist(one.flatten(1), other.flatten(1)) / math.sqrt(one.shape[1])


def _between(shapes: Tensor) -> Tensor:
    half = len(shapes) // 2
    return _distances(shapes[:half], shapes[half:]).mean()


def _effective(labels: Tensor) -> float:
    share = torch.bincount(labels) / len(labels)
    return float(torch.special.entr(share).sum().exp())

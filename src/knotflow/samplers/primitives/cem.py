"""The cross-entropy method: splines that the critic thinks best (Fig. 5, Sec. VII-B1).

TorchRL's CEMPlanner would do this through a one-step environment whose reward is the critic, with
normalised actions. It returns one elite mean a state, planning state by state by `env.rollout`;
here many distinct proposals a rope are wanted, so each is a search of its own with its own
population, and all searches of all ropes run as one batch on features computed once a rope.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor


def cross_entropy(
    score: Callable[[Tensor], Tensor],
    mean: Tensor,
    factor: Tensor,
    noise: Tensor,
    elites: int,
) -> tuple[Tensor, Tensor]:
    """Run R searches at once.

    Args:
        score: values (R, P) of splines (R, P, 6); higher is better.
        mean: (R, 6) of the first Gaussian of each search.
        factor: (R, 6, 6) lower Cholesky factor of its covariance.
        noise: (iterations, R, P, 6) standard normal numbers, all the randomness there is.
        elites: number of best splines kept, at most P.

    Returns:
        The mean of the last elites (R, 6), and the best value found among them (R,).
    """
    best = mean.new_zeros(len(mean))
    for numbers in noise:
        splines = mean[:, None] + numbers @ factor.transpose(1, 2)  # (R, P, 6)
        values, order = score(splines).topk(elites, dim=1)
        kept = splines.gather(1, order[..., None].expand(-1, -1, splines.shape[-1]))
        best = values[:, 0]
        mean = kept.mean(dim=1)
        factor = torch.diag_embed(kept.std(dim=1, correction=0) + 1e-3)
    return mean, best


def standard_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Tensor:
    """Numbers for a search, float32, from NumPy's generator."""
    return torch.from_numpy(rng.standard_normal(shape, dtype=np.float32))

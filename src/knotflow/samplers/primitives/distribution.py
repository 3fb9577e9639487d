"""Distributions over splines in network space, from which a search begins (Fig. 4, "mu, Sigma")."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.distributions import MultivariateNormal, Normal

SPLINE = 6
NODES = 64
"""Nodes of the rope among which a categorical grasp chooses, evenly spaced from tip to tip."""


@dataclass(frozen=True)
class Gaussian:
    """N(mean, factor factor^T) for each of S ropes."""

    mean: Tensor  # (S, 6)
    factor: Tensor  # (S, 6, 6) lower Cholesky factors

    def draw(self, noise: Tensor) -> Tensor:
        """Splines (S, n, 6) from standard normal numbers of that shape."""
        return self.mean[:, None] + noise @ self.factor.mT

    def log_prob(self, splines: Tensor, owner: Tensor) -> Tensor:
        """Log densities (N,) of splines (N, 6) on ropes `owner` (N,), int64."""
        density: Tensor = self._normal(owner).log_prob(splines)
        return density

    @property
    def entropy(self) -> Tensor:
        """(S,) nats."""
        entropy: Tensor = self._normal(slice(None)).entropy()
        return entropy

    def _normal(self, rows: Tensor | slice) -> Any:
        mean, factor = self.mean[rows], self.factor[rows]
        return MultivariateNormal(mean, scale_tril=factor, validate_args=False)

    @property
    def spread(self) -> Tensor:
        """(S, ...) standard deviations."""
        return self.factor.square().sum(-1).sqrt()

    def widened(self, factor: float, floor: float) -> Gaussian:
        """Deviations times `factor`, and `floor` added to them in every direction."""
        added = floor**2 * torch.eye(SPLINE)
        covariance = factor**2 * self.factor @ self.factor.mT + added
        return Gaussian(self.mean, torch.linalg.cholesky(covariance))

    def repeat(self, count: int) -> Gaussian:
        """Each one `count` times, next to each other."""
        return Gaussian(
            self.mean.repeat_interleave(count, 0), self.factor.repeat_interleave(count, 0)
        )


@dataclass(frozen=True)
class NodeGaussian:
    """A categorical over the rope's nodes for the grasp, uniform over what is nearest to the node,
    and a diagonal Gaussian over the other numbers given the node, as in the authors' code."""

    log_share: Tensor  # (S, NODES) log probability of each node
    mean: Tensor  # (S, NODES, 5)
    deviation: Tensor  # (S, NODES, 5)
    grasp: Tensor  # (S, 2) position along the rope, 0..1, that is 0 in network space, and a unit

    def draw(self, noise: Tensor) -> Tensor:
        below = torch.special.ndtr(noise[..., 0]).clamp(0, 1 - 1e-6)
        shares = self.log_share.exp()
        reached = shares.cumsum(-1).contiguous()
        node = torch.searchsorted(reached, below * reached[:, -1:], right=True)
        node = node.clamp(max=NODES - 1)  # (S, n)
        share = shares.gather(1, node)
        within = (below * reached[:, -1:] - (reached.gather(1, node) - share)) / share
        low, width = _cells(node)
        position = low + within.clamp(0, 1) * width
        grasp = (position - self.grasp[:, :1]) / self.grasp[:, 1:]
        row = node[..., None].expand(*node.shape, SPLINE - 1)
        others = self.mean.gather(1, row) + self.deviation.gather(1, row) * noise[..., 1:]
        return torch.cat([grasp[..., None], others], dim=-1)

    def log_prob(self, splines: Tensor, owner: Tensor) -> Tensor:
        centre, unit = self.grasp[owner].unbind(-1)
        position = (centre + unit * splines[:, 0]).clamp(0, 1)
        node = (position * (NODES - 1)).round().long()
        normal: Any = Normal(self.mean[owner, node], self.deviation[owner, node])
        others: Tensor = normal.log_prob(splines[:, 1:]).sum(-1)
        return self.log_share[owner, node] - torch.log(_cells(node)[1] / unit.abs()) + others

    @property
    def entropy(self) -> Tensor:
        width = _cells(torch.arange(NODES))[1] / self.grasp[:, 1:].abs()
        of_others = (self.deviation.log() + 0.5 * math.log(2 * math.pi * math.e)).sum(-1)
        return (self.log_share.exp() * (of_others + width.log() - self.log_share)).sum(-1)

    @property
    def spread(self) -> Tensor:
        return self.deviation

    def widened(self, factor: float, floor: float) -> NodeGaussian:
        share = (self.log_share / factor**2).log_softmax(-1)
        deviation = (factor**2 * self.deviation**2 + floor**2).sqrt()
        return NodeGaussian(share, self.mean, deviation, self.grasp)

    def repeat(self, count: int) -> NodeGaussian:
        fields = self.log_share, self.mean, self.deviation, self.grasp
        return NodeGaussian(*(one.repeat_interleave(count, 0) for one in fields))


SplineDistribution = Gaussian | NodeGaussian


def _cells(node: Tensor) -> tuple[Tensor, Tensor]:
    """Where the part of the rope that is nearest to a node begins, and its length, 0..1."""
    low = ((node - 0.5) / (NODES - 1)).clamp(min=0)
    high = ((node + 0.5) / (NODES - 1)).clamp(max=1)
    return low, high - low

"""How far predicted nodes are from a known rope, whichever of its ends they begin at.

Millimetres are the fit's business; which strand is on top at a crossing is not, as the fit can
hardly turn a crossing round. So heights are held to the truth at crossings above all.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from knotflow.perception.coarse_to_fine import Nodes, resampled
from knotflow.perception.training_config import LossConfig


def nodes_loss(found: Sequence[Nodes], truth: Tensor, config: LossConfig | None = None) -> Tensor:
    """Loss (N,) of the nodes of every level, coarse first, against ropes (N, V, 3).

    The finest level has V nodes. Of the truth's two orders the one that is nearer counts, so the
    loss is the same for a rope given from its other end.
    """
    config = config or LossConfig()
    orders = [_ordered_loss(found, one, config) for one in (truth, truth.flip(1))]
    return torch.minimum(*orders)


def vertex_error(places: Tensor, truth: Tensor) -> Tensor:
    """Mean distance (N,) in the patch of vertices (N, V, 3) to the truth, from the nearer end."""
    errors = [
        (places[..., :2] - one[..., :2]).norm(dim=-1).mean(dim=1) for one in (truth, truth.flip(1))
    ]
    return torch.minimum(*errors)


def crossings_right(places: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """How many crossings (N,) of ropes (N, V, 3) are the right way round, and how many there are.

    At the truth's crossings the heights of the prediction are compared, from the nearer end.
    """
    forward = (places[..., :2] - truth[..., :2]).norm(dim=-1).mean(dim=1)
    backward = (places[..., :2] - truth.flip(1)[..., :2]).norm(dim=-1).mean(dim=1)
    nearer = torch.where((backward < forward)[:, None, None], truth.flip(1), truth)
    rope, over, under = crossings(nearer)
    right = (_height(places, rope, over) > _height(places, rope, under)).to(places)
    empty = places.new_zeros(len(places))
    return empty.index_add(0, rope, right), empty.index_add(0, rope, torch.ones_like(right))


def crossings(truth: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where ropes (N, V, 3) cross themselves in the patch.

    Returns:
        For each of C crossings of all ropes: the rope (C,), and where along it, 0..V-1, the upper
        and the lower strand (C,) are.
    """
    links = truth.shape[1] - 1
    one, other = torch.triu_indices(links, links, offset=2)
    start, link = truth[:, :-1, :2], truth[:, 1:, :2] - truth[:, :-1, :2]
    p, d = start[:, one], link[:, one]
    q, e = start[:, other], link[:, other]
    apart, turn = q - p, _cross(d, e)
    safe = torch.where(turn.abs() < 1e-12, torch.full_like(turn, 1e-12), turn)
    s, t = _cross(apart, e) / safe, _cross(apart, d) / safe
    rope, pair = torch.nonzero((s >= 0) & (s < 1) & (t >= 0) & (t < 1), as_tuple=True)
    first = one[pair] + s[rope, pair]
    second = other[pair] + t[rope, pair]
    swapped = _height(truth, rope, first) < _height(truth, rope, second)
    return rope, torch.where(swapped, second, first), torch.where(swapped, first, second)


def _ordered_loss(found: Sequence[Nodes], truth: Tensor, config: LossConfig) -> Tensor:
    total = truth.new_zeros(len(truth))
    for places, log_scale in found:
        error = places - resampled(truth, places.shape[1])
        apart = (error[..., :2].square().sum(dim=-1) + 1e-8).sqrt()
        likelihood = apart.detach() * torch.exp(-log_scale) + log_scale
        each = config.place * apart + config.height * error[..., 2].abs()
        total = total + (each + config.scale * likelihood).mean(dim=1)
    rope, over, under = crossings(truth)
    finest = found[-1].places
    missing = config.gap - (_height(finest, rope, over) - _height(finest, rope, under))
    return total.index_add(0, rope, config.crossing * missing.clamp(min=0))


def _height(ropes: Tensor, rope: Tensor, along: Tensor) -> Tensor:
    """Heights (C,) of ropes (N, V, 3) numbered `rope` (C,) at places `along` (C,), 0..V-1."""
    before = along.floor().long().clamp(max=ropes.shape[1] - 2)
    share = along - before
    height = ropes[..., 2]
    return (1 - share) * height[rope, before] + share * height[rope, before + 1]


def _cross(one: Tensor, other: Tensor) -> Tensor:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]

"""Trials seen from another frame: rigid motions of rope and spline on the table.

They change nothing, so the copies are as true as the trials. The networks' frame is attached to
one place of the rope (`primitives.encoding`); jitter keeps them from trusting just this place, the
more so as demonstrations have few start shapes.
"""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from knotflow.training.config import AugmentationConfig


def augment(
    batch: TensorDict, config: AugmentationConfig, generator: torch.Generator
) -> TensorDict:
    """A batch as `losses` describes it, each rope with its trials moved at random."""
    ropes = len(batch["states"])
    angle = config.turn * torch.randn(ropes, generator=generator)
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], dim=1)
    turn = turn.reshape(ropes, 2, 2)
    shift = config.shift * torch.randn(ropes, 1, 2, generator=generator)
    streams = batch["states"]["streams"].clone()
    streams[..., :2] = streams[..., :2] @ turn.mT + shift
    streams[..., 4:6] = streams[..., 4:6] @ turn.mT  # directions
    owner, spline = batch["owner"], batch["spline"].clone()
    for columns in (slice(1, 3), slice(4, 6)):
        spline[:, columns] = _move(spline[:, columns], turn[owner], shift[owner, 0])
    out = batch.copy()
    out["states"] = batch["states"].copy().update({"streams": streams})
    out["spline"] = spline
    return out


def _move(points: Tensor, turn: Tensor, shift: Tensor) -> Tensor:
    return (turn @ points[..., None])[..., 0] + shift

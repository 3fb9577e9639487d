"""Smooth deformations of the table, as copies of trials on other rope shapes.

A smooth one-to-one map of the plane changes no topology, neither of the rope nor of what a motion
does to it. If it is gentle the physics hardly notice either: rope and spline bent together succeed
or fail as they did. Demonstrations have few start shapes, one for R1 and R2, and without such
copies the networks learn what these few shapes have in common by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDict
from torch import Tensor

from knotflow.primitives.encoding import PLANE_SCALE, STREAM_POINTS

HALF_METRE = 0.5 / PLANE_SCALE
_STEP = 0.05  # network units, over which the direction of a rope is carried along


@dataclass
class AugmentationConfig:
    """Standard deviations of the random maps: rigid motion after quadratic terms about the rope's
    middle."""

    turn: float = 0.2
    """Of the rotation a of the frame, radians."""
    shift: float = 0.1
    """Of each coordinate of the displacement b, network units."""
    bend: float = 0.15
    """Of the real and imaginary part of each quadratic coefficient: how much, at half a metre from
    the middle, places move in units of this distance, and half of how much angles turn."""


def augment(
    batch: TensorDict, config: AugmentationConfig, generator: torch.Generator
) -> TensorDict:
    """A batch as `losses` describes it, with each rope and its trials mapped at random."""
    ropes = len(batch["states"])

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    turn = torch.polar(torch.ones(ropes), config.turn * normal(ropes))
    shift = config.shift * torch.complex(normal(ropes), normal(ropes))
    quadratic = config.bend * torch.complex(normal(3, ropes), normal(3, ropes))

    def warp(z: Tensor, rows: Tensor | slice) -> Tensor:
        shape = (-1,) + (1,) * (z.ndim - 1)
        a, b, c = (one[rows].reshape(shape) for one in quadratic)
        far = (z - middle[rows].reshape(shape)) / HALF_METRE
        bent = z + HALF_METRE * (a * far * far + b * far * far.conj() + c * (far * far).conj())
        return turn[rows].reshape(shape) * bent + shift[rows].reshape(shape)

    streams = batch["states"]["streams"].clone()
    place = torch.view_as_complex(streams[..., :2].contiguous())
    middle = place[:, -STREAM_POINTS[-1] :].mean(dim=1)
    direction = torch.view_as_complex(streams[..., 4:6].contiguous())
    moved = warp(place, slice(None))
    carried = warp(place + _STEP * direction, slice(None)) - moved
    streams[..., :2] = torch.view_as_real(moved)
    streams[..., 4:6] = torch.view_as_real(carried / carried.abs().clamp(min=1e-6))
    splines = batch["spline"].clone()
    for columns in (slice(1, 3), slice(4, 6)):
        point = torch.view_as_complex(splines[:, columns].contiguous())
        splines[:, columns] = torch.view_as_real(warp(point, batch["owner"]))
    out = batch.copy()
    out["states"] = batch["states"].copy().update({"streams": streams})
    out["spline"] = splines
    return out

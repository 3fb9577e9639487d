"""A rope as a camera sees it, differentiable in its vertices (Sec. VI, extended to depth).

A rope is a chain of capsules. A pixel's ray passes each link at some distance d, and the link
covers it by alpha = sigmoid((radius - d) / softness). Links are laid over each other front to
back: the nearest link takes its alpha of the pixel, the next takes its alpha of what is left. So
an upper strand hides a lower one exactly, and a strand nearby does not leak into the depth.

Only pixels near a link are worked out, some 7,000 pairs of pixel and link in place of 3 million, by
compiled loops (`rasterising`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from knotflow.perception.camera import Camera
from knotflow.perception.rasterising import lay, lay_back

_REACH = 5.0  # softnesses from a link's surface, where alpha is below 1 %


def render(
    points: Tensor,
    radius: float,
    camera: Camera,
    softness: float = 1e-3,
    seen_radius: float | None = None,
) -> tuple[Tensor, Tensor]:
    """Depth and occupancy of the image of a rope, or of many, each in an image of its own.

    Args:
        points: (..., V, 3) vertices, metres, world frame.
        radius: of the rope, metres.
        camera: that looks at it.
        softness: distance over which the rope's edge fades, metres. A gradient reaches a few times
            as far: large for a rough guess, small for a close one.
        seen_radius: of the rope's silhouette, metres, where it is seen thicker or thinner than its
            surface is high, see `Target`.

    Returns:
        depth (..., H, W): of the rope's surface along the optical axis, metres; NaN where no link
            is near. Where the rope covers a pixel in part, the depth is that of the covered part.
        occupancy (..., H, W): share of a pixel that the rope covers, 0..1.
    """
    ropes = _in_camera(points.reshape(-1, *points.shape[-2:]).double(), camera)  # (B, V, 3)
    seen_radius = radius if seen_radius is None else seen_radius
    depth, occupancy = _Laid.apply(ropes, radius, seen_radius, softness, camera)
    shape = *points.shape[:-2], camera.height, camera.width
    return depth.view(shape).to(points), occupancy.view(shape).to(points)


def _in_camera(points: Tensor, camera: Camera) -> Tensor:
    """Points (..., 3) in the camera's frame: x right, y down, z along the optical axis."""
    rotation, position = (
        torch.as_tensor(array, dtype=points.dtype) for array in (camera.rotation, camera.position)
    )
    return (points - position) @ rotation


class _Laid(torch.autograd.Function):
    """Depth and occupancy (B * H * W,) of ropes (B, V, 3) in the camera's frame."""

    @staticmethod
    def forward(
        ctx: Any,
        ropes: Tensor,
        radius: float,
        seen_radius: float,
        softness: float,
        camera: Camera,
    ) -> tuple[Tensor, Tensor]:
        vertices = np.ascontiguousarray(ropes.detach().numpy())
        eye = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        size = camera.height, camera.width
        reach = seen_radius + _REACH * softness
        laid = lay(vertices, radius, seen_radius, softness, reach, eye, *size)
        ctx.made = (vertices, radius, seen_radius, softness, eye, *size, laid)
        return torch.from_numpy(laid[0]), torch.from_numpy(laid[1])

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        arrays = [np.ascontiguousarray(one.numpy()) for one in slopes]
        by_ropes = lay_back(*ctx.made, *arrays)
        return torch.from_numpy(by_ropes), None, None, None, None

"""A rope as a camera sees it, differentiable in its vertices (Sec. VI, extended to depth).

A rope is a chain of capsules. A pixel's ray passes each link at some distance d, and the link
covers it by alpha = sigmoid((radius - d) / softness). Links are laid over each other front to
back: the nearest link takes its alpha of the pixel, the next takes its alpha of what is left. So
an upper strand hides a lower one exactly, and a strand nearby does not leak into the depth: what
is left is summed as log sigmoid, which stays exact where alpha is nearly one.

Only pixels near a link are worked out, some 7,000 pairs of pixel and link in place of 3 million.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import logsigmoid

from knotflow.perception.camera import Camera

_REACH = 5.0  # softnesses from a link's surface, where alpha is below 1 %
_GRAZING = 0.1  # of the squared radius: bounds the slope of a link's surface at its silhouette
_STEEPEST = 0.3  # sine of the angle between ray and link, below which a link is seen end on


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
    rope = _in_camera(points.reshape(-1, *points.shape[-2:]), camera)  # (B, V, 3)
    start = rope[:, :-1].reshape(-1, 3).T  # (3, B E)
    link = (rope[:, 1:] - rope[:, :-1]).reshape(-1, 3).T
    seen_radius = radius if seen_radius is None else seen_radius
    reach = seen_radius + _REACH * softness
    pixel, owner = _pairs(start.detach(), link.detach(), reach, camera)  # (P,)
    distance, depth = _pass(
        start.index_select(1, owner), link.index_select(1, owner), _rays(pixel, camera), radius
    )
    image = owner // (rope.shape[1] - 1)
    pixel = pixel + camera.height * camera.width * image

    # By pixel, and front to back within each, as far as a kilometre.
    order = torch.argsort(pixel + 1e-3 * depth.detach())
    pixel, depth = pixel[order], depth[order]
    inside = (seen_radius - distance[order]) / softness
    left = torch.cumsum(logsigmoid(-inside), 0)  # log of what all links so far leave uncovered
    group, first = _groups(pixel)
    before = torch.cat([left.new_zeros(1), left[:-1]])  # what links before this one leave
    weight = torch.exp(logsigmoid(inside) + before - before[first][group])

    seen = pixel[first]
    covered = weight.new_zeros(len(first)).index_add(0, group, weight)
    mean = weight.new_zeros(len(first)).index_add(0, group, weight * depth) / (covered + 1e-12)
    shape = *points.shape[:-2], camera.height, camera.width
    size = len(rope) * camera.height * camera.width
    deep = points.new_full((size,), torch.nan).index_put((seen,), mean)
    occupancy = points.new_zeros(size).index_put((seen,), covered)
    return deep.view(shape), occupancy.view(shape)


def _in_camera(points: Tensor, camera: Camera) -> Tensor:
    """Points (..., 3) in the camera's frame: x right, y down, z along the optical axis."""
    rotation, position = (
        torch.as_tensor(array, dtype=points.dtype) for array in (camera.rotation, camera.position)
    )
    return (points - position) @ rotation


def _pairs(start: Tensor, link: Tensor, reach: float, camera: Camera) -> tuple[Tensor, Tensor]:
    """Pixels (P,) as flat indices, each with one of the links (3, E) that lies within `reach` of
    its ray."""
    ahead = torch.nonzero(start[2].minimum(start[2] + link[2]) > reach)[:, 0]
    if len(ahead) == 0:
        return ahead, ahead
    middle = (start + 0.5 * link)[:, ahead]
    column = camera.fx * middle[0] / middle[2] + camera.cx
    row = camera.fy * middle[1] / middle[2] + camera.cy
    half = 0.5 * link[:, ahead].norm(dim=0)
    oblique = middle.norm(dim=0) / middle[2]  # a ball off the axis is drawn longer
    size = (half + reach) * oblique / (middle[2] - half) * max(camera.fx, camera.fy)
    # Links that leave the picture are cut, so a window never needs to exceed it.
    extent = int(torch.ceil(size.max()).clamp(max=max(camera.width, camera.height)))
    step = torch.arange(-extent, extent + 1)
    u, v = column.round().long()[:, None] + step, row.round().long()[:, None] + step  # (E, n)
    across, down = (u >= 0) & (u < camera.width), (v >= 0) & (v < camera.height)
    # Of this square around the link's middle, what lies in the band along it.
    square = _squared_distances(start[:, ahead].double(), link[:, ahead].double(), u, v, camera)
    near = (square < reach**2) & across[:, None, :] & down[:, :, None]
    owner, i, j = torch.nonzero(near, as_tuple=True)
    return v[owner, i] * camera.width + u[owner, j], ahead[owner]


def _squared_distances(start: Tensor, link: Tensor, u: Tensor, v: Tensor, camera: Camera) -> Tensor:
    """(E, n, n) of links (3, E) from the rays of pixels at rows v and columns u (E, n), each link
    with its own. As `_apart`, by dot products alone: for pixels of a window these are sums of what
    a row and a column give."""
    x = ((u - camera.cx) / camera.fx)[:, None, :].double()
    y = ((v - camera.cy) / camera.fy)[:, :, None].double()
    per_length = (x * x + (y * y + 1)).rsqrt()
    (sx, sy, sz), (lx, ly, lz) = start[..., None, None], link[..., None, None]
    ahead, onward = (sx * x + (sy * y + sz)) * per_length, (lx * x + (ly * y + lz)) * per_length
    starts, links, both = (
        (one * other).sum(0)[:, None, None]
        for one, other in ((start, start), (link, link), (start, link))
    )
    square, skew = links - onward * onward, both - ahead * onward
    along = (-skew / (square + 1e-12)).clamp(0, 1)
    return starts - ahead * ahead + along * (2 * skew + along * square)


def _rays(pixel: Tensor, camera: Camera) -> Tensor:
    """Unit directions (3, P) in the camera's frame."""
    x = (pixel % camera.width - camera.cx) / camera.fx
    y = (pixel // camera.width - camera.cy) / camera.fy
    direction = torch.stack([x, y, torch.ones_like(x)]).double()
    return direction / direction.square().sum(0).sqrt()


def _pass(start: Tensor, link: Tensor, ray: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """How rays (3, P) from the origin pass links (3, P): distance (P,) of ray and link, and depth
    (P,) at which the ray enters the link, metres."""
    offset, square, reached = _apart(start, link, ray)
    distance = (offset.square().sum(0) + 1e-14).sqrt()
    chord = (radius**2 - distance**2).clamp(min=_GRAZING * radius**2).sqrt()
    sine = (square / (link * link).sum(0)).clamp(min=_STEEPEST**2).sqrt()
    return distance, (reached - chord / sine) * ray[2]


def _apart(start: Tensor, link: Tensor, ray: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """From rays (3, P) from the origin to the nearest point of links (3, P): offset (3, P), the
    square (P,) of the link's length across the ray, and how far along the ray it is (P,)."""
    ahead, onward = (start * ray).sum(0), (link * ray).sum(0)
    aside, across = start - ahead * ray, link - onward * ray
    square = (across * across).sum(0)
    along = (-(aside * across).sum(0) / (square + 1e-12)).clamp(0, 1)
    return aside + along * across, square, ahead + along * onward


def _groups(pixel: Tensor) -> tuple[Tensor, Tensor]:
    """For sorted pixels (P,): which distinct one each is (P,), and where each begins (G,)."""
    _, group, count = torch.unique_consecutive(pixel, return_inverse=True, return_counts=True)
    return group, torch.cumsum(count, 0) - count

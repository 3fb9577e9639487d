"""Windows along ropes to train the strand network on, drawn from rope shapes by the thousand."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from knotflow.perception.examples import placed, rasterise, seen_so
from knotflow.perception.strand_network import HALF, HEADINGS, SIDE, STEP, TRAIL, WIDEST
from knotflow.perception.supervision import crossings
from knotflow.perception.training_config import ExamplesConfig

ASIDE = 0.4
"""Standard deviation of a window's middle from the strand, along both axes, radii."""
TURNED = 0.15
"""Standard deviation of its direction from the strand's, radians."""
UNEVEN = 0.3
"""Standard deviation of the trail's points, along both axes and in height, radii."""
RAISED = 0.7
"""Standard deviation of all of its heights together, radii."""
CUT = 0.2
"""Share of the trails that begin somewhere along the rope."""
NEAR = 3.0
"""Links from a crossing, at most, of the half of the windows that lie near one."""


class Windows(NamedTuple):
    """`windows` (N, 5, SIDE, SIDE) and `height` (N,), radii, as `StrandNetwork` takes them; the
    `heading` (N,) of the next step, index; `next_height` (N,), radii; `end` (N,) bool, whether the
    rope ends before."""

    windows: Tensor
    height: Tensor
    heading: Tensor
    next_height: Tensor
    end: Tensor


@torch.no_grad()
def draw_windows(
    points: Tensor, radius: float, config: ExamplesConfig, generator: torch.Generator
) -> Windows:
    """A window somewhere along each of the rope shapes (N, V, 3), metres, seen at random."""
    count, vertices, _ = points.shape
    links = vertices - 1

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=generator)

    def normal(std: float, *shape: int) -> Tensor:
        return std * torch.randn(count, *shape, generator=generator)

    places, thick = placed(points, radius, config, generator)
    ropes = torch.cat([places, points[..., 2:]], dim=-1) / radius
    link = float((ropes[0, 1:] - ropes[0, :-1]).norm(dim=-1).mean())  # radii
    step, backward = STEP / link, uniform(0, 1) < 0.5
    ropes = torch.where(backward[:, None, None], ropes.flip(1), ropes)

    at = uniform(0, links)
    rope, over, under = crossings(ropes)
    chosen = torch.randperm(2 * len(rope), generator=generator)
    near = at.clone()
    near[rope.repeat(2)[chosen]] = torch.cat([over, under])[chosen]
    near = (near + uniform(-NEAR, NEAR)).clamp(0, links)
    at = torch.where(uniform(0, 1) < 0.5, near, at)

    here, following = along(ropes, at), along(ropes, at + step)
    tangent = (along(ropes, at + 0.3) - along(ropes, at - 0.3))[:, :2]
    angle = torch.atan2(tangent[:, 1], tangent[:, 0]) + normal(TURNED)
    middle = here[:, :2] + normal(ASIDE, 2)
    mirror = torch.where(uniform(0, 1) < 0.5, 1.0, -1.0)
    begun = torch.where(uniform(0, 1) < CUT, uniform(0, TRAIL), float(TRAIL))
    steps = step * torch.minimum(torch.arange(TRAIL + 1), begun[:, None])
    trail = along(ropes, (at[:, None] - steps).clamp(min=0))
    trail = trail + normal(UNEVEN, 1, 3) + normal(UNEVEN, TRAIL + 1, 3)
    raised = normal(RAISED)
    trail[:, 0, :2], trail[..., 2] = middle, (trail[..., 2] + raised[:, None]).clamp(min=1)
    height = (here[:, 2] + raised + normal(UNEVEN)).clamp(min=1)

    local = turned(ropes, middle, angle, mirror)
    covered, top = rasterise(local, thick / HALF, SIDE)
    window = with_trail(
        seen_so(covered, top, config, generator), turned(trail, middle, angle, mirror)
    )
    onward = turned(following[:, None], middle, angle, mirror)[:, 0]
    heading = torch.atan2(onward[:, 1], onward[:, 0])
    index = ((heading + WIDEST) * (HEADINGS / (2 * WIDEST))).floor().long().clamp(0, HEADINGS - 1)
    return Windows(window, height, index, following[:, 2], at + step > links)


def along(ropes: Tensor, at: Tensor) -> Tensor:
    """Points of ropes (N, V, C) at places (N,) or (N, M) along them, 0..V-1, cut to their ends."""
    last = ropes.shape[1] - 1
    flat = at.reshape(len(at), -1).clamp(0, last)
    before = flat.floor().long().clamp(max=last - 1)
    share = (flat - before)[..., None]
    index = before[..., None].expand(-1, -1, ropes.shape[2])
    found = (1 - share) * ropes.gather(1, index) + share * ropes.gather(1, index + 1)
    return found.reshape(*at.shape, -1)


def turned(points: Tensor, middle: Tensor, angle: Tensor, mirror: Tensor | None = None) -> Tensor:
    """Points (N, K, 3), radii, in windows around `middle` (N, 2): places in units of HALF, the
    first axis at an `angle` (N,), radians, the second times `mirror` (N,); heights as they were."""
    cosine, sine = angle.cos()[:, None], angle.sin()[:, None]
    x, y = (points[..., :2] - middle[:, None]).unbind(-1)
    first, second = cosine * x + sine * y, cosine * y - sine * x
    if mirror is not None:
        second = second * mirror[:, None]
    return torch.stack([first / HALF, second / HALF, points[..., 2]], dim=-1)


def with_trail(seen: Tensor, trail: Tensor) -> Tensor:
    """Windows (N, 5, SIDE, SIDE) of what is seen (N, 3, SIDE, SIDE) and a trail (N, K, 3)."""
    thin = trail.new_full((len(trail),), 0.7 / HALF)
    covered, top = rasterise(trail, thin, SIDE)
    return torch.cat([seen, covered[:, None], (covered * top)[:, None]], dim=1)

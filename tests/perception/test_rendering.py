"""The renderer against rays cast at balls, and its gradient against finite differences."""

import numpy as np
import pytest
import torch

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.camera.rendering import render

from .shapes import CAMERA, ROPE, loop, s_curve, seen_exactly


@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_rendering_matches_ray_casting(points):
    depth, mask = seen_exactly(points)
    drawn, occupancy = (one.numpy() for one in render(torch.tensor(points), ROPE.radius, CAMERA))
    both = mask & (occupancy > 0.9)
    assert both.sum() > 0.6 * mask.sum()
    off = np.abs(drawn - depth)[both]
    assert np.median(off) < 2e-4
    assert np.quantile(off, 0.95) < 1.5e-3
    assert occupancy[~mask].max() < 0.9
    assert occupancy.sum() == pytest.approx(mask.sum(), rel=0.1)


def test_upper_strand_occludes_lower():
    rope = torch.tensor([[-0.1, 0, 0.1], [0.1, 0, 0.1], [0, 0.3, 0.1], [0, 0.1, 0], [0, -0.1, 0]])
    rope = rope.double().requires_grad_()
    camera = Camera.overhead(81, 61)
    depth, _ = render(rope, 0.02, camera)
    assert depth[30, 40].item() == pytest.approx(camera.position[2] - 0.12, abs=1e-6)
    depth[30, 40].backward()
    assert rope.grad is not None and rope.grad[3:].abs().max() < 1e-6
    assert rope.grad[:2].abs().max() > 0.1


def test_gradients_match_finite_differences():
    points = torch.tensor(loop())
    weights = torch.rand(2, CAMERA.height, CAMERA.width, generator=torch.Generator().manual_seed(1))

    def loss(shape):
        depth, occupancy = render(shape, ROPE.radius, CAMERA, 3e-3)
        return (weights[0] * occupancy).sum() + (weights[1] * occupancy * depth.nan_to_num()).sum()

    shape = points.clone().requires_grad_()
    loss(shape).backward()
    generator = torch.Generator().manual_seed(2)
    for _ in range(8):
        direction = torch.randn(points.shape, generator=generator).double()
        step = 1e-7
        rise = loss(points + step * direction) - loss(points - step * direction)
        slope = float((shape.grad * direction).sum())
        assert float(rise) / (2 * step) == pytest.approx(slope, rel=2e-2, abs=0.5)


def test_rope_out_of_view():
    for away in ([3.0, 0, 0], [0, 0, 5.0]):
        depth, occupancy = render(torch.tensor(s_curve() + away), ROPE.radius, CAMERA)
        assert depth.isnan().all() and occupancy.sum() == 0

"""Drawn patches look like those that a camera sees."""

import numpy as np
import pytest
import torch

from knotflow.perception.networks.examples import ExamplesConfig, draw_patches, rasterise
from knotflow.perception.networks.patches import crop_rope

from .shapes import CAMERA, ROPE, loop, s_curve
from .test_patches import exact

PERFECT = ExamplesConfig(scale=0, turn=0, shift=0, noise=0, blur=0, sharpen=0, lost=0, hidden=0)


def batch(*shapes: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(np.stack(shapes), dtype=torch.float32)


@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_rasterised_rope_matches_camera(points):
    patch, crop = crop_rope(*exact(points), CAMERA, ROPE, 64)
    nodes = batch(patch.from_world(points, CAMERA))
    covered, height = rasterise(nodes, torch.tensor([ROPE.radius / patch.half]), 64)
    assert covered.sum().item() == pytest.approx(crop[0].sum(), rel=0.15)
    assert np.abs(covered[0].numpy() - crop[0]).mean() < 0.25 * crop[0].mean()
    inside = (covered[0].numpy() > 0.9) & (crop[0] > 0.9)
    assert inside.sum() > 10
    assert np.median(np.abs(height[0].numpy() - crop[1])[inside]) < 0.3


def test_rasterised_area():
    nodes = torch.zeros(1, 41, 3)
    nodes[0, :, 0] = torch.linspace(-0.5, 0.5, 41)
    nodes[0, :, 2] = 1
    covered, height = rasterise(nodes, torch.tensor([0.05]), 96)
    pixel = 2 / 96
    assert covered.sum().item() * pixel**2 == pytest.approx(0.1 + np.pi * 0.05**2, rel=0.02)
    assert height.max().item() == pytest.approx(2, abs=0.05)


def test_the_upper_strand_is_seen():
    nodes = torch.zeros(1, 41, 3)
    nodes[0, :20, 0] = torch.linspace(-0.5, 0.5, 20)
    nodes[0, 20:, 1] = torch.linspace(-0.5, 0.5, 21)
    nodes[0, :20, 2], nodes[0, 20:, 2] = 3, 1
    _, height = rasterise(nodes, torch.tensor([0.05]), 96)
    assert height[0, 46:50, 46:50].min().item() > 3


def test_ropes_lie_within_patches():
    shapes = batch(*[s_curve(), loop(1)] * 8)
    examples = draw_patches(
        shapes, ROPE.radius, 48, ExamplesConfig(), torch.Generator().manual_seed(0)
    )
    assert examples.patches.shape == (16, 3, 48, 48)
    assert examples.nodes[..., :2].abs().max() < 1.2
    assert examples.patches[:, ::2].min() >= 0 and examples.patches[:, ::2].max() <= 1
    links = (examples.nodes[:, 1:, :2] - examples.nodes[:, :-1, :2]).norm(dim=-1)
    length = (links.sum(dim=1) * examples.half).numpy()
    assert length == pytest.approx(ROPE.length, rel=0.1)  # seen from aside and above


def test_draws_are_reproducible():
    one, other = (
        draw_patches(
            batch(loop(1)), ROPE.radius, 32, ExamplesConfig(), torch.Generator().manual_seed(3)
        )
        for _ in range(2)
    )
    assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


def test_heights_without_noise():
    shapes = batch(s_curve())
    patches, _, _ = draw_patches(shapes, ROPE.radius, 96, PERFECT, torch.Generator().manual_seed(1))
    covered, raised, known = patches[0]
    assert (known == 1).all()
    assert raised[covered == 1].max().item() == pytest.approx(2, abs=0.05)
    assert (raised[covered == 0] == 0).all()

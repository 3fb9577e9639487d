"""Patches of ropes, seen or drawn."""

import numpy as np
import pytest
import torch

from knotflow.perception.networks.windows import Patch, project_to_plane, rasterise

from .shapes import CAMERA, ROPE, loop, nodes_in, s_curve, target

PATCH = Patch(np.array([0.02, -0.01]), 0.6, ROPE.radius)
"""Holds every shape."""


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_to_world_puts_nodes_back(points):
    nodes = nodes_in(PATCH, points)
    assert np.abs(nodes[:, :2]).max() < 1
    assert nodes[:, 2] == pytest.approx(points[:, 2] / ROPE.radius)
    assert PATCH.to_world(nodes, CAMERA) == pytest.approx(points, abs=1e-12)


def test_raised_vertex_is_on_its_ray():
    raised = np.array([[0.3, -0.2, 0.1]])
    place = project_to_plane(raised, CAMERA.position, ROPE.radius)
    both = CAMERA.project([raised[0], [*place[0], ROPE.radius]])
    assert both[0, :2] == pytest.approx(both[1, :2])


def test_hidden_pixels_are_unknown():
    seen = target(s_curve())
    row, column = np.argwhere(seen.mask.numpy())[40]
    window = np.s_[row - 6 : row + 7, column - 6 : column + 7]
    seen.mask[window] = seen.known[window] = False
    crop = PATCH.crop(seen, 96)
    assert crop[2].min() < 0.1
    assert np.median(crop[2]) > 0.9


def test_on_plane_inverts_project():
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[100, 200] = True
    (place,) = CAMERA.on_plane(mask, ROPE.radius)
    assert CAMERA.project([*place, ROPE.radius])[:2] == pytest.approx([200, 100])


def batch(*shapes: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(np.stack(shapes), dtype=torch.float32)


@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_rasterised_rope_matches_camera(points):
    crop = PATCH.crop(target(points), 96)
    nodes = batch(nodes_in(PATCH, points))
    covered, height = rasterise(nodes, torch.tensor([ROPE.radius / PATCH.half]), 96)
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

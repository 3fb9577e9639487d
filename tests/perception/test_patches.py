"""Patches around ropes, seen or drawn."""

import numpy as np
import pytest
import torch

from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.patches import (
    ExamplesConfig,
    Patch,
    crop_rope,
    draw_patches,
    project_to_plane,
    rasterise,
)

from .shapes import CAMERA, ROPE, bare, loop, nodes_in, s_curve, target

SIZE = 48
PERFECT = ExamplesConfig(scale=0, turn=0, shift=0, noise=0, blur=0, sharpen=0, lost=0, hidden=0)


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def mirror_images(crop: np.ndarray) -> list[np.ndarray]:
    return [crop[:, ::down, ::right] for down in (1, -1) for right in (1, -1)]


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_to_world_puts_nodes_back(points):
    patch, _ = crop_rope(target(points), SIZE)
    nodes = nodes_in(patch, points)
    assert np.abs(nodes[:, :2]).max() < 1
    assert nodes[:, 2] == pytest.approx(points[:, 2] / ROPE.radius)
    assert patch.to_world(nodes, CAMERA) == pytest.approx(points, abs=1e-12)


def test_raised_vertex_is_on_its_ray():
    raised = np.array([[0.3, -0.2, 0.1]])
    place = project_to_plane(raised, CAMERA.position, ROPE.radius)
    both = CAMERA.project([raised[0], [*place[0], ROPE.radius]])
    assert both[0, :2] == pytest.approx(both[1, :2])


@pytest.mark.parametrize("angle", [0.5, 2.0, np.pi])
def test_patch_rotates_with_rope(angle):
    places = s_curve()[:, :2]
    one = Patch.around(places, ROPE.radius, ROPE.length)
    other = Patch.around(turned(s_curve(), angle)[:, :2], ROPE.radius, ROPE.length)
    assert other.half == pytest.approx(one.half)
    assert other.centre == pytest.approx(turned(np.array([[*one.centre, 0]]), angle)[0, :2])
    axes = turned(np.column_stack([one.axes.T, [0, 0]]), angle)[:, :2].T
    assert np.abs(axes.T @ other.axes) == pytest.approx(np.eye(2), abs=1e-9)


@pytest.mark.parametrize("angle", [0.5, np.pi])
def test_crop_is_rotation_invariant(angle):
    _, crop = crop_rope(target(loop(1)), SIZE)
    _, other = crop_rope(target(turned(loop(1), angle) + [0.05, -0.03, 0]), SIZE)
    nearest = min(np.abs(crop - one)[0].sum() for one in mirror_images(other))
    assert nearest < 0.4 * crop[0].sum()  # pixels fall otherwise
    assert np.abs(crop - np.rot90(crop, axes=(1, 2)))[0].sum() > crop[0].sum()  # were it not so


def test_hidden_pixels_are_unknown():
    seen = target(s_curve())
    row, column = np.argwhere(seen.mask.numpy())[40]
    window = np.s_[row - 6 : row + 7, column - 6 : column + 7]
    seen.mask[window] = seen.known[window] = False
    _, crop = crop_rope(seen, SIZE)
    assert crop[2].min() < 0.1
    assert np.median(crop[2]) > 0.9


def test_on_plane_inverts_project():
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[100, 200] = True
    (place,) = CAMERA.on_plane(mask, ROPE.radius)
    assert CAMERA.project([*place, ROPE.radius])[:2] == pytest.approx([200, 100])


def test_crop_without_rope_raises():
    with pytest.raises(TraceError, match="no rope"):
        crop_rope(bare(), SIZE)


def batch(*shapes: np.ndarray) -> torch.Tensor:
    return torch.as_tensor(np.stack(shapes), dtype=torch.float32)


@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_rasterised_rope_matches_camera(points):
    patch, crop = crop_rope(target(points), 64)
    nodes = batch(nodes_in(patch, points))
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

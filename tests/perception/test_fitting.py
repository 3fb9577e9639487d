"""Fits and their losses."""

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist

from knotflow.perception.estimation.evidence import Target
from knotflow.perception.estimation.fitting import (
    bending_loss,
    depth_loss,
    fit,
    length_loss,
    nearest_places,
    overlap,
    overlap_loss,
    project_lengths,
    register,
    silhouette_loss,
    table_loss,
)
from knotflow.simulation import resample

from .shapes import CAMERA, ROPE, loop, s_curve, target


@pytest.mark.slow
@pytest.mark.parametrize("points", [s_curve(), loop()], ids=["flat", "loop"])
def test_fit_reduces_error_from_11_to_2_mm(points, rng):
    along = np.linspace(0, np.pi, len(points))[:, None]
    off = sum(np.cos(k * along + rng.uniform(0, 6)) * rng.normal(size=3) for k in range(1, 4))
    off[:, 2] *= 0.2
    off *= 0.011 / np.linalg.norm(off, axis=1).mean()
    found = fit(points + off, target(points))
    assert np.linalg.norm(found - points, axis=1).mean() < 2e-3
    lengths = np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(lengths, ROPE.link_length, rtol=1e-6)


def test_project_lengths_equalises_links(rng):
    points = s_curve() + rng.normal(0, 2e-3, (41, 3))
    found = project_lengths(points, ROPE.link_length)
    lengths = np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(lengths, ROPE.link_length, rtol=1e-8)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    np.testing.assert_allclose(found.mean(axis=0), points.mean(axis=0), atol=1e-9)


def test_project_lengths_keeps_equal_links():
    points = loop()
    np.testing.assert_allclose(project_lengths(points, ROPE.link_length), points, atol=1e-9)


def test_straight_rope_has_no_shape_loss():
    points = torch.tensor([[0.025 * i, 0, ROPE.radius] for i in range(41)])
    assert length_loss(points, 0.025) == pytest.approx(0, abs=1e-6)
    assert bending_loss(points, 0.025) == pytest.approx(0, abs=1e-6)
    assert table_loss(points, ROPE.radius) == overlap_loss(points, ROPE.radius) == 0


def test_table_loss_gradient_points_up():
    points = torch.tensor(s_curve() - [0, 0, 0.01]).requires_grad_()
    table_loss(points, ROPE.radius).backward()
    assert (points.grad[:, 2] < 0).all()


def test_overlap_loss_gradient_separates_strands():
    points = torch.tensor(
        [[-0.1, 0, 0.02], [0.1, 0, 0.02], [0.3, 0.3, 0.02], [0, 0.1, 0.01], [0, -0.1, 0.01]]
    ).requires_grad_()
    overlap_loss(points, 0.01).backward()
    assert points.grad[:2, 2].max() < 0 < points.grad[3:, 2].min()


def test_overlap_gradient_matches_finite_differences(rng):
    # A rope on a lattice of a few places, so that strands meet in all ways.
    points = torch.tensor(
        0.02 * rng.integers(0, 3, (4, 20, 3)) + 2e-3 * rng.normal(size=(4, 20, 3))
    )
    shape = points.clone().requires_grad_()
    loss = overlap_loss(shape, 0.01)
    assert loss.shape == (4,) and (loss > 1).all()
    loss.sum().backward()
    step, way = 1e-6, torch.tensor(rng.normal(size=points.shape))
    rise = overlap_loss(points + step * way, 0.01) - overlap_loss(points - step * way, 0.01)
    slope = (shape.grad * way).sum((1, 2))
    assert (rise / (2 * step)).tolist() == pytest.approx(slope.tolist(), rel=1e-3)


def test_unknown_pixels_have_no_loss():
    rope, known = np.zeros((2, 4, 5), bool)
    rope[1, 1:4] = known[1] = True
    depth = np.full((4, 5), np.nan)
    depth[1, 1] = 1.0
    seen = (torch.as_tensor(one) for one in (rope, known, depth, depth, rope.astype(float)))
    target = Target(CAMERA, ROPE, *seen)
    occupancy = torch.ones(4, 5).double().requires_grad_()
    drawn = torch.full((4, 5), 1.1).double().requires_grad_()
    silhouette_loss(occupancy, target).backward()
    depth_loss(drawn, occupancy, target, 0.01).backward()
    wrong = torch.zeros(4, 5, dtype=torch.bool)
    wrong[1, [0, 4]] = True  # table that is known
    assert ((occupancy.grad != 0) == wrong).all()
    assert torch.nonzero(drawn.grad).tolist() == [[1, 1]]


def test_binned_target_keeps_coverage():
    fine = target(s_curve())
    coarse = fine.binned(2)
    assert coarse.coverage.shape == (120, 160)
    assert float(4 * coarse.coverage.sum()) == pytest.approx(float(fine.coverage.sum()))
    assert coarse.known.all()
    on_rope = coarse.depth[coarse.mask]
    assert float(on_rope.nanmean()) == pytest.approx(float(fine.depth[fine.mask].mean()), abs=2e-3)


def test_nearest_places_match_sampled_minimum(rng):
    share = np.linspace(0, 1, 60)[:, None]
    for p, d, q, e in rng.normal(size=(30, 4, 3)):
        s, t = nearest_places(*(tuple(one) for one in (p, d, q, e)))
        found = np.linalg.norm(p + s * d - q - t * e)
        least = cdist(p + share * d, q + share * e).min()
        assert found == pytest.approx(least, abs=0.02)
        assert found <= least + 1e-6


def test_overlap_ignores_neighbouring_links():
    folded = np.array([[[0, 0, 0], [1, 0, 0], [1, 0.1, 0], [0, 0.1, 0], [0, 0.2, 0]]], float)
    assert overlap(folded, 0.05)[0].item() == pytest.approx(0.0)  # links 0 and 2 are 0.1 apart
    loss, slope = overlap(folded, 0.1)  # and so are 0 and 3, which would have to be 0.2
    assert loss[0] == pytest.approx(1.0)
    assert slope[0, 0, 1] > 0 > slope[0, 3, 1]


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_register_keeps_aligned_rope(points):
    found = register(points, resample(points, ROPE), ROPE)
    assert np.linalg.norm(found - points, axis=1).max() < 1e-3


def test_register_recovers_translation():
    points = s_curve()
    found = register(points - [0.0, 0.03, 0.0], points, ROPE)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    assert np.linalg.norm(np.diff(found, axis=0), axis=1) == pytest.approx(
        ROPE.link_length, rel=1e-5
    )


def test_hidden_vertices_follow_visible_ones():
    points, shift = s_curve(), np.array([0.0, 0.015, 0.0])
    found = register(points - shift, np.r_[points[:17], points[24:]], ROPE)
    assert (found - points + shift)[17:24, 1].mean() > 0.7 * shift[1]


def test_register_without_points_changes_nothing():
    points = s_curve()
    assert np.array_equal(register(points, np.zeros((0, 3)), ROPE), points)

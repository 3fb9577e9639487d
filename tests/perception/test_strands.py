"""Strand tracing, its windows and network."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch

from knotflow.perception.estimation.evidence import observe
from knotflow.perception.networks.network import NextStep, StrandNetwork, shipped_network
from knotflow.perception.networks.strands import (
    PIXEL,
    StrandPath,
    headings,
    trace_rope,
    trace_strands,
)
from knotflow.perception.networks.training import next_step_loss
from knotflow.perception.networks.windows import (
    HALF,
    SIDE,
    STEP,
    WIDEST,
    ExamplesConfig,
    draw_windows,
    points_at,
    rasterise,
    to_window,
)
from knotflow.simulation import state_or_none

from .shapes import CAMERA, ROPE, bare, image, loop, s_curve, shape_error
from .test_network import TINY

PERFECT = ExamplesConfig(noise=0, blur=0, sharpen=0, lost=0, hidden=0)
LENGTH = ROPE.length / ROPE.radius


class Hound(torch.nn.Module):
    """Goes where a window shows rope one step ahead, and ends where it shows none."""

    def forward(self, windows: torch.Tensor, height: torch.Tensor) -> NextStep:
        angles = headings()
        ahead = STEP / HALF * torch.stack([angles.cos(), angles.sin()], dim=-1)
        grid = ahead.expand(len(windows), 1, -1, -1)
        seen = torch.nn.functional.grid_sample(windows[:, :1], grid, align_corners=False)[:, 0, 0]
        # Rope ahead counts less the farther it is from straight on.
        logits = 6 * seen - angles.square()
        return NextStep(logits.log_softmax(1), height, 20 * (0.4 - seen.amax(1)))


def table_map(points: np.ndarray) -> torch.Tensor:
    """A map (3, S, S) of the table around the origin, without noise, of a rope (V, 3), metres."""
    size = 2 * int(np.abs(points[:, :2]).max() / ROPE.radius / PIXEL + HALF / PIXEL)
    half = size * PIXEL / 2
    nodes = points / ROPE.radius / [half, half, 1.0]
    covered, top = rasterise(torch.as_tensor(nodes[None]).float(), torch.tensor([1 / half]), size)
    return torch.cat([covered, covered * top, torch.ones_like(covered)])


def off(path: StrandPath, points: np.ndarray) -> float:
    """Largest distance of a path's points from a rope (V, 3) metres, in the plane, radii."""
    fine = points_at(torch.as_tensor(points[None]), torch.linspace(0, len(points) - 1, 2000)[None])[
        0
    ]
    apart = path.points[:, None, :2] - fine.numpy()[None, :, :2] / ROPE.radius
    return float(np.linalg.norm(apart, axis=-1).min(axis=1).max())


def windows(
    *shapes: np.ndarray,
    config: ExamplesConfig = PERFECT,
    seed: int = 0,
    radii: Sequence[float] = (ROPE.radius,),
):
    batch = torch.as_tensor(np.stack(shapes), dtype=torch.float32)
    each = torch.tensor(radii).expand(len(shapes))
    return draw_windows(batch, each, config, torch.Generator().manual_seed(seed))


def test_a_window_is_turned_along_the_strand_around_its_middle():
    middle, angle = torch.tensor([[3.0, -1.0]]), torch.tensor([0.7])
    ahead = middle + STEP * torch.stack([angle.cos(), angle.sin()], dim=1)
    points = torch.stack([torch.cat([one, torch.tensor([[2.0]])], 1)[0] for one in (middle, ahead)])
    found = to_window(points[None], middle, angle)[0]
    assert found[0].tolist() == pytest.approx([0, 0, 2], abs=1e-6)
    assert found[1].tolist() == pytest.approx([STEP / HALF, 0, 2], abs=1e-6)


def test_windows_show_the_strand_and_its_trail():
    found = windows(*[s_curve()] * 64)
    assert found.windows.shape == (64, 5, SIDE, SIDE)
    middle = slice(SIDE // 2 - 1, SIDE // 2 + 1)
    assert found.windows[:, 0, middle, middle].mean() > 0.8
    # On a rope without crossings the trail lies on the rope, behind the middle.
    trail, rope = found.windows[:, 3], found.windows[:, 0]
    assert (trail * rope).sum() > 0.8 * trail.sum()
    assert trail[..., : SIDE // 2].sum() > 5 * trail[..., SIDE // 2 + 2 :].sum()


def test_windows_are_as_wide_as_their_rope_is_thick():
    full, half = s_curve(), 0.5 * s_curve()
    alike = windows(*[full] * 32)
    mixed = windows(*[full, half] * 16, radii=[ROPE.radius, 0.5 * ROPE.radius] * 16)
    assert torch.allclose(alike.windows, mixed.windows, atol=1e-4)
    thin = windows(*[full] * 32, radii=[0.5 * ROPE.radius])
    assert (thin.windows[:, 0].mean() / alike.windows[:, 0].mean()).item() > 0.7  # in its radii


def test_a_strand_goes_on_where_rope_is_ahead():
    found = windows(*[s_curve()] * 256)
    on = ~found.end
    angle = headings()[found.heading[on]]
    assert angle.abs().max() < WIDEST and angle.abs().mean() < 0.4
    told = Hound()(found.windows[on], found.height[on]).heading.argmax(dim=1)
    assert (headings()[told] - angle).abs().median() < 0.3
    # One in LENGTH / STEP windows is less than a step from the end.
    assert 0 < int(found.end.sum()) < 256 * 10 * STEP / LENGTH


def test_the_same_generator_draws_the_same_windows():
    one, other = (windows(loop(1), config=ExamplesConfig(), seed=3) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [s_curve(), loop(1)], ids=["flat", "loop"])
def test_path_follows_rope(shape):
    best = trace_strands(Hound(), table_map(shape), LENGTH)[0]
    assert off(best, shape) < 1.0
    assert best.length == pytest.approx(LENGTH, rel=0.08)
    ends = sorted(float(np.abs(best.points[one, :2]).sum()) for one in (0, -1))
    truth = sorted(float(np.abs(shape[one, :2]).sum()) / ROPE.radius for one in (0, -1))
    assert ends == pytest.approx(truth, abs=3)


@pytest.mark.slow
def test_path_does_not_repeat_itself():
    for path in trace_strands(Hound(), table_map(loop(1)), LENGTH):
        steps = np.linalg.norm(np.diff(path.points[:, :2], axis=0), axis=1)
        assert steps == pytest.approx(STEP)
        assert path.length < 1.15 * LENGTH and len(path.probability) == len(path.points)
        assert (0 < path.probability).all() and (path.probability <= 1).all()


def test_an_empty_table_has_no_paths():
    assert trace_strands(Hound(), torch.zeros(3, 120, 120), LENGTH) == []
    assert trace_rope(Hound(), bare()) == []


def test_empty_strand_is_no_path():
    class Blind(Hound):
        def forward(self, windows: torch.Tensor, height: torch.Tensor) -> NextStep:
            return super().forward(windows, height)._replace(end=torch.full_like(height, 20.0))

    assert trace_strands(Blind(), table_map(s_curve()), LENGTH) == []


@pytest.mark.slow
@pytest.mark.parametrize("over", [1, -1])
def test_shipped_network_traces_loop(over):
    points = loop(over)
    shape = trace_rope(shipped_network(), observe(image(points), CAMERA, ROPE))[0]
    assert shape.shape == points.shape
    assert np.linalg.norm(np.diff(shape, axis=0), axis=1) == pytest.approx(ROPE.link_length)
    assert shape_error(shape, points) < 0.012
    state = state_or_none(points)
    assert state in (state_or_none(shape), state_or_none(shape[::-1]))


@pytest.mark.slow
def test_strand_network_overfits_windows():
    found = windows(*[loop(1), s_curve()] * 16)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = StrandNetwork(TINY)
    optimizer = torch.optim.Adam(model.parameters(), 3e-3)
    before = next_step_loss(model(found.windows, found.height), found).item()
    for _ in range(150):
        loss = next_step_loss(model(found.windows, found.height), found)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.1 * before

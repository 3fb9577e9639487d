"""A mask's path is followed from end to end, straight through its crossings."""

import numpy as np
import pytest

from knotflow.perception.estimation.segmentation import pixel_coverage, segment
from knotflow.perception.estimation.skeleton import TraceError, lift, trace
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, image, loop, s_curve, seen_exactly

PIXELS = CAMERA.fx / CAMERA.position[2]  # of a metre on the table


@pytest.mark.parametrize("points", [s_curve(), loop(1), loop(-1)], ids=["flat", "over", "under"])
def test_trace_and_lift(points):
    depth, mask = seen_exactly(points)
    path = trace(mask, 2 * ROPE.radius * PIXELS, PIXELS)[0]
    guess = lift(path, mask, depth, CAMERA, ROPE)
    off = min(np.linalg.norm(turned - points, axis=1).mean() for turned in (guess, guess[::-1]))
    assert off < 0.012
    state = TopologicalState.from_curve(guess)
    truth = TopologicalState.from_curve(points)
    assert state in (truth, truth.reversed())


@pytest.mark.parametrize("angle", [20, 45, 90])
def test_trace_continues_straight_at_crossings(angle):
    v, u = np.mgrid[:80, :100]
    mask = np.abs(v - 40) < 2
    turn = np.deg2rad(angle)
    mask |= np.abs((u - 50) * np.sin(turn) - (v - 40) * np.cos(turn)) < 2
    mask[0:6] = mask[-6:] = False
    mask[:, 0:6] = mask[:, -6:] = False
    path = trace(mask, 4.0)[0]  # two ropes, and a path is one of them
    straight = path[0] + np.linspace(0, 1, len(path))[:, None] * (path[-1] - path[0])
    assert np.abs(path - straight).max() < 3


def test_trace_of_empty_mask_raises():
    mask = np.zeros((60, 80), bool)
    with pytest.raises(TraceError, match="0 pixels"):
        trace(mask, 3.0)
    mask[30, 40] = True
    with pytest.raises(TraceError, match="longer than a rope is wide"):
        trace(mask, 3.0)


def test_trace_of_a_speck_with_four_arms_raises():
    mask = np.zeros((60, 80), bool)
    mask[27:34, 40] = mask[30, 37:44] = True
    with pytest.raises(TraceError, match="longer than a rope is wide"):
        trace(mask, 3.0)


def test_pixel_coverage_of_mixed_colours(rng):
    seen = image(s_curve())
    whole = segment(seen, CAMERA, ROPE.radius)
    blurred = (0.5 * seen.rgb + 0.5 * np.roll(seen.rgb, 1, axis=0)).astype(np.uint8)
    share = pixel_coverage(type(seen)(blurred, seen.depth), whole)
    mixed = (share > 0.4) & (share < 0.6)
    assert share.min() >= 0 and share.max() <= 1
    assert mixed.sum() > 100
    assert share[~whole.rope & ~mixed].max() < 0.1

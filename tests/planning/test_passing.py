"""A strand that passes through another one is found, one that goes round an end is not."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.planning.passing import find_passages
from knotflow.simulation import RopeSimulator, SimulationConfig, straight


def loop(height: float, cross: float = 0.1) -> np.ndarray:
    """A rope (41, 3) whose tail passes `height` above its head, `cross` metres beyond it."""
    corners = [(0.0, 0.0), (0.4, 0.0), (0.4, 0.3), (0.2, 0.3), (0.2, -cross)]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.linspace(0, along[-1] - 1e-4, 41)
    points = np.zeros((41, 3))
    for axis in (0, 1):
        points[:, axis] = np.interp(at, along, np.array(corners)[:, axis])
    points[-16:, 2] = height
    points[:, :2] += 1e-4 * np.arange(41)[:, None]  # nothing lies exactly on anything
    return points


def test_strands_that_keep_their_order_have_no_passage():
    trajectory = np.stack([loop(0.016 + 0.002 * frame) for frame in range(8)])
    assert find_passages(trajectory) == []


def test_a_strand_that_sinks_through_another_is_found_where_and_when_it_does():
    trajectory = np.stack([loop(0.02 - 0.005 * frame) for frame in (0, 1, 2, 3, 5, 6)])
    (passage,) = find_passages(trajectory)
    assert passage.frame == 4
    assert passage.places[0] < passage.places[1]
    mirrored = find_passages(trajectory * [1, -1, 1])
    assert [one.frame for one in mirrored] == [4]
    reversed_ = find_passages(trajectory[:, ::-1])
    places = sorted(1 - place for place in passage.places)
    np.testing.assert_allclose(sorted(reversed_[0].places), places, atol=1e-12)


def test_an_end_may_be_drawn_back_and_led_under_instead():
    over = [loop(0.016, cross) for cross in (0.10, 0.06, 0.02, -0.02, -0.06)]
    under = [loop(-0.016, cross) for cross in (-0.06, -0.02, 0.02, 0.06)]
    assert find_passages(np.stack([*over, *under])) == []


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_a_simulated_rope_does_not_pass_through_itself(rate):
    simulator = RopeSimulator(SimulationConfig(threads=1, record_rate=rate))
    rope = straight(simulator.config.rope)
    splines = np.array([[0.02, 0.3, 0.25, 0.2, 0.1, -0.15], [0.98, -0.3, 0.25, 0.2, -0.1, -0.15]])
    for trajectory in simulator.execute(np.stack([rope, rope]), splines).trajectory:
        assert find_passages(trajectory) == []

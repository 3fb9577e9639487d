"""The frame of a start shape: exact both ways, and the same wherever a rope lies."""

import numpy as np
import pytest

from knotflow.samplers.causal_infogan.data import StartFrame
from knotflow.simulation import RopeConfig, random_curve


@pytest.fixture
def trajectories(rng):
    """(2, 3, V, 3): two ropes, each at rest and then twice shaken."""
    starts = np.stack([random_curve(RopeConfig(), rng) for _ in range(2)])
    return starts[:, None] + rng.normal(0, 0.02, (2, 3, 41, 3)) * [[[0]], [[1]], [[1]]]


def test_leaving_a_frame_undoes_entering_it(trajectories):
    frame = StartFrame.of(trajectories[:, 0])
    assert np.allclose(frame.leave(frame.enter(trajectories)), trajectories)
    assert np.allclose(frame.leave(frame.enter(trajectories[:, 1])), trajectories[:, 1])


def test_a_rope_looks_the_same_wherever_it_lies(trajectories):
    turn = 2.3
    cos, sin = np.cos(turn), np.sin(turn)
    moved = trajectories @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + [0.2, -0.1, 0]
    here = StartFrame.of(trajectories[:, 0]).enter(trajectories)
    assert np.allclose(StartFrame.of(moved[:, 0]).enter(moved), here)


def test_the_start_lies_along_x_on_the_table(trajectories):
    start = StartFrame.of(trajectories[:, 0]).enter(trajectories)[:, 0]
    assert np.allclose(start.mean(axis=1)[:, :2], 0)
    assert np.allclose(start[..., 2], trajectories[:, 0, :, 2])
    assert (start[:, -1, 0] > start[:, 0, 0]).all()

"""Errors of predictions, on motions that are known."""

import numpy as np
import torch

from knotflow.execution import FREE, Motions, Still, prediction_errors

FRAMES, VERTICES, RELEASED = 26, 41, 18


def drifting(count=4, speed=0.01):
    """Ropes that move by `speed` metres a step along x, held until they are let go."""
    points = np.zeros((count, FRAMES, VERTICES, 3), np.float32)
    points[..., 0] = np.linspace(-0.5, 0.5, VERTICES)
    points[..., 0] += speed * np.arange(FRAMES)[None, :, None]
    grasped = np.where(np.arange(FRAMES) < RELEASED, 20, FREE)
    gripper = (points[:, :, 20] + points[:, :, 21]) / 2
    return Motions(points, gripper, np.tile(grasped, (count, 1)), np.arange(count) % 2)


class Oracle:
    """Knows how the ropes drift, and what it was told."""

    def __init__(self):
        self.asked = []

    def predict(self, points, velocities, grasped, gripper):
        self.asked.append((grasped.tolist(), gripper.shape[1]))
        steps = torch.arange(1, gripper.shape[1] + 1)[None, :, None, None]
        return points[:, None] + steps * torch.tensor([0.01, 0.0, 0.0])


def test_standing_still_is_wrong_by_what_the_rope_moved():
    table = prediction_errors({"still": Still()}, drifting())
    assert list(table.columns) == ["model", "level", "steps", "motions", "mean_error_mm"]
    for row in table.itertuples():
        assert np.isclose(row.mean_error_mm, 10.0 * row.steps, atol=0.01)
        assert row.motions == 2
    assert sorted(set(table.level)) == [0, 1]


def test_a_model_is_told_when_the_rope_is_let_go():
    oracle = Oracle()
    table = prediction_errors({"oracle": oracle}, drifting())
    grasped = [20] * RELEASED + [FREE] * (FRAMES - 1 - RELEASED)
    assert oracle.asked == [([grasped] * 4, FRAMES - 1)]
    assert table.mean_error_mm.max() < 0.01

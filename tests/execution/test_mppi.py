"""MPPI on a rope that is easy to predict: it moves as a whole with the gripper."""

import numpy as np
import pytest
import torch

from knotflow.execution import Mppi, MppiConfig, StaticDynamics

FRAMES, VERTICES, LINK = 19, 41, 20


class Rigid:
    """Every vertex moves as the held link's centre does."""

    def predict(self, points, velocities, grasped, gripper):
        centre = (points[:, LINK] + points[:, LINK + 1]) / 2
        return points[:, None] + (gripper - centre[:, None])[:, :, None]


class Biased(Rigid):
    """Besides, it believes that the rope drifts by 1 cm a tick."""

    def predict(self, *asked):
        return super().predict(*asked) + torch.tensor([0.0, 0.01, 0.0])


def begin(config, off=(0.03, -0.02, 0.0), dynamics=None, weights=None):
    """A controller, and the rope, which is off the reference by some metres."""
    controller = Mppi(dynamics or Rigid(), config)
    rope = np.zeros((VERTICES, 3))
    rope[:, 0] = np.linspace(-0.5, 0.5, VERTICES)
    rope[:, 2] = 0.05
    path = np.array([0.0, 0.0, 0.05]) + np.linspace(0, 1, FRAMES)[:, None] * [0.1, 0.2, 0.0]
    reference = rope + (path - path[0])[:, None]
    controller.begin(reference, path, np.ones(VERTICES) if weights is None else weights, LINK)
    return controller, rope + off, reference


def apart(controller, points, reference):
    """What each vertex is off the reference after each tick (T, V, 3), metres."""
    off = []
    for wanted in reference[1:]:
        centre = (points[LINK] + points[LINK + 1]) / 2
        points = points + controller.act(points, np.zeros_like(points), centre) - centre
        off.append(points - wanted)
    return np.array(off)


def follow(controller, points, reference):
    """The mean distance from the reference after each tick, metres."""
    return np.linalg.norm(apart(controller, points, reference), axis=2).mean(axis=1)


def test_displaced_rope_returns_to_the_plan():
    off = follow(*begin(MppiConfig()))
    assert off[0] > 0.015
    assert off[-5:].max() < 0.006


def test_rope_on_the_plan_stays():
    assert follow(*begin(MppiConfig(), off=(0.0, 0.0, 0.0))).max() < 0.006


@pytest.mark.parametrize("part", [slice(None, LINK), slice(LINK, None)])
def test_vertices_count_by_their_weights(part):
    """A rope whose tail lies 3 cm aside is moved back as far as its tail counts."""
    aside, weights = np.zeros((VERTICES, 3)), np.zeros(VERTICES)
    aside[LINK:, 0], weights[part] = 0.03, 1.0
    off = apart(*begin(MppiConfig(), aside, weights=weights))
    assert np.abs(off[-1, part]).max() < 0.008


def test_errors_of_the_gripper_do_not_add_up():
    controller, points, reference = begin(MppiConfig(), (0.0, 0.0, 0.0), StaticDynamics())
    centre, placed = (points[LINK] + points[LINK + 1]) / 2, []
    for tick, wanted in enumerate(reference[:-1]):
        error = [0.0 if tick == 0 else 0.005, 0.0, 0.0]
        placed.append(controller.act(wanted, np.zeros_like(points), centre + error))
        centre = placed[-1]
    wanted = (reference[-1, LINK] + reference[-1, LINK + 1]) / 2
    assert np.linalg.norm(placed[-1] - wanted) < 0.03


def test_model_bias_is_not_corrected():
    on_plan = begin(MppiConfig(), off=(0.0, 0.0, 0.0), dynamics=Biased())
    assert follow(*on_plan).max() < 0.006
    off = follow(*begin(MppiConfig(), dynamics=Biased()))
    assert off[-5:].max() < 0.006


def test_same_seed_same_moves():
    one, other = (follow(*begin(MppiConfig(seed=5))) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_actions_stay_within_bounds():
    config = MppiConfig(bound=0.004)
    controller, points, reference = begin(config, off=(0.2, 0.2, -0.1))
    centre = (points[LINK] + points[LINK + 1]) / 2
    there = controller.act(points, np.zeros_like(points), centre)
    planned = reference[1, LINK] - reference[0, LINK]
    assert np.abs((there - centre - planned)[:2]).max() <= 0.004 + 1e-6
    assert there[2] >= config.table


@pytest.mark.usefixtures("two_threads")
def test_acts_on_one_thread(monkeypatch):
    threads, predict = set(), Rigid.predict

    def counted(*arguments):
        threads.add(torch.get_num_threads())
        return predict(*arguments)

    monkeypatch.setattr(Rigid, "predict", counted)
    controller, points, _ = begin(MppiConfig())
    controller.act(points, np.zeros_like(points), points[LINK])
    assert threads == {1}
    assert torch.get_num_threads() == 2


def test_static_dynamics_keep_the_planned_path():
    controller, points, reference = begin(MppiConfig(), dynamics=StaticDynamics())
    off = follow(controller, points, reference)
    assert off[-1] == pytest.approx(np.hypot(0.03, 0.02), abs=0.02)

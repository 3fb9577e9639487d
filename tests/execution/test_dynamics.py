"""One contract for all models of a rope, and what sets each apart."""

import numpy as np
import pytest
import torch

from knotflow.execution import FREE, LstmDynamics, MujocoDynamics, Still
from knotflow.simulation import RopeConfig, SimulationConfig, random_curve

MODELS = {
    "still": Still,
    "lstm": LstmDynamics.load,
    "mujoco": lambda: MujocoDynamics(SimulationConfig(threads=1)),
}


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]()


def ropes(rng, count=3):
    points = np.stack([random_curve(RopeConfig(), rng) for _ in range(count)])
    return torch.from_numpy(points).float()


def drag(points, link, steps=3, by=(0.01, 0.005, 0.01)):
    """The gripper (B, H, 3) that drags a link's centre evenly."""
    centre = (points[:, link] + points[:, link + 1]) / 2
    return centre[:, None] + torch.arange(1, steps + 1)[:, None] * torch.tensor(by)


def test_a_prediction_is_finite_and_as_long_as_the_gripper(model, rng):
    points = ropes(rng)
    grasped = torch.tensor([0, 17, FREE])
    ahead = model.predict(points, torch.zeros_like(points), grasped, drag(points, 17, 4))
    assert ahead.shape == (3, 4, 41, 3)
    assert ahead.dtype == torch.float32
    assert ahead.isfinite().all()


def test_a_row_does_not_depend_on_the_others(model, rng):
    points = ropes(rng)
    grasped, still = torch.tensor([5, 17, FREE]), torch.zeros_like(points)
    gripper = drag(points, 17)
    together = model.predict(points, still, grasped, gripper)
    alone = model.predict(points[1:2], still[1:2], grasped[1:2], gripper[1:2])
    torch.testing.assert_close(together[1:2], alone, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", ["lstm", "mujoco"])
def test_a_dragged_link_goes_with_the_gripper(name, rng):
    points = ropes(rng)
    gripper = drag(points, 20, 5)
    grasped = torch.full((3,), 20)
    ahead = MODELS[name]().predict(points, torch.zeros_like(points), grasped, gripper)
    centre = (ahead[:, -1, 20] + ahead[:, -1, 21]) / 2
    assert (centre - gripper[:, -1]).norm(dim=-1).max() < 0.02


def test_the_learned_rope_turns_with_its_start(rng):
    model, points = LstmDynamics.load(), ropes(rng)
    gripper, grasped = drag(points, 8), torch.full((3,), 8)
    cos, sin = np.cos(1.0), np.sin(1.0)
    turn = torch.tensor([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]], dtype=torch.float32)
    still = torch.zeros_like(points)
    ahead = model.predict(points, still, grasped, gripper)
    turned = model.predict(points @ turn, still, grasped, gripper @ turn)
    torch.testing.assert_close(turned, ahead @ turn, atol=1e-4, rtol=0)


def test_mujoco_predicts_what_the_simulator_does(simulator, plan):
    step = plan.steps[0]
    link = int(step.spline[0] * 40)
    points = torch.from_numpy(step.start)[None]
    gripper = torch.from_numpy(step.gripper[1:11])[None]
    model = MujocoDynamics(SimulationConfig(threads=1))
    ahead = model.predict(points, torch.zeros_like(points), torch.tensor([link]), gripper)
    truth = torch.from_numpy(step.trajectory[1:11])
    # Within a tick the gripper is taken to move evenly, which it does not when it starts and stops.
    away = (ahead[0] - truth).norm(dim=-1).mean(1)
    moved = (truth - points[0]).norm(dim=-1).mean(1)
    assert away[0] < 0.008
    assert (away[3:] < 0.35 * moved[3:]).all(), (away, moved)


def test_a_saved_model_predicts_the_same(tmp_path, rng):
    model, points = LstmDynamics.load(), ropes(rng)
    model.save(tmp_path / "model.safetensors")
    again = LstmDynamics.load(tmp_path / "model.safetensors")
    arguments = points, torch.zeros_like(points), torch.full((3,), 4), drag(points, 4)
    torch.testing.assert_close(again.predict(*arguments), model.predict(*arguments))

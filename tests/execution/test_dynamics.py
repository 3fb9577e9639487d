"""One contract for all models of a rope, and what sets each apart."""

import numpy as np
import pytest
import torch

from knotflow.execution import (
    FREE,
    LstmDynamics,
    ModelPrediction,
    Motions,
    MujocoDynamics,
    StaticDynamics,
    draw_motions,
    motion_errors,
    prediction_errors,
)
from knotflow.execution.motions import STEP
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.simulation import RopeConfig, SimulationConfig, random_curve


def mujoco_dynamics():
    return MujocoDynamics(SimulationConfig(threads=1))


MODELS = {"still": StaticDynamics, "lstm": LstmDynamics.load, "mujoco": mujoco_dynamics}


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


def test_prediction_shape_and_dtype(model, rng):
    points = ropes(rng)
    grasped = torch.tensor([0, 17, FREE])
    ahead = model.predict(points, torch.zeros_like(points), grasped, drag(points, 17, 4))
    assert ahead.shape == (3, 4, 41, 3)
    assert ahead.dtype == torch.float32
    assert ahead.isfinite().all()


def test_rows_are_independent(model, rng):
    points = ropes(rng)
    grasped, still = torch.tensor([5, 17, FREE]), torch.zeros_like(points)
    gripper = drag(points, 17)
    together = model.predict(points, still, grasped, gripper)
    alone = model.predict(points[1:2], still[1:2], grasped[1:2], gripper[1:2])
    torch.testing.assert_close(together[1:2], alone, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", ["lstm", "mujoco"])
def test_dragged_link_follows_the_gripper(name, rng):
    points = ropes(rng)
    gripper = drag(points, 20, 5)
    grasped = torch.full((3,), 20)
    ahead = MODELS[name]().predict(points, torch.zeros_like(points), grasped, gripper)
    centre = (ahead[:, -1, 20] + ahead[:, -1, 21]) / 2
    assert (centre - gripper[:, -1]).norm(dim=-1).max() < 0.02


def test_lstm_is_equivariant_to_rotation(rng):
    model, points = LstmDynamics.load(), ropes(rng)
    gripper, grasped = drag(points, 8), torch.full((3,), 8)
    cos, sin = np.cos(1.0), np.sin(1.0)
    turn = torch.tensor([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]], dtype=torch.float32)
    still = torch.zeros_like(points)
    ahead = model.predict(points, still, grasped, gripper)
    turned = model.predict(points @ turn, still, grasped, gripper @ turn)
    torch.testing.assert_close(turned, ahead @ turn, atol=1e-4, rtol=0)


@pytest.fixture(scope="module")
def nominal_motions():
    """Eight ropes like the planner's, dragged and let go."""
    simulation = SimulationConfig(threads=1)
    rng = np.random.default_rng(0)
    return draw_motions(load_demonstrations(), simulation, 0, 8, rng)


@pytest.mark.slow
def test_mujoco_matches_the_simulator(nominal_motions):
    away = 1e3 * motion_errors(mujoco_dynamics(), nominal_motions).mean(axis=-1)
    assert len(away) == 8
    assert np.median(away[:, 0]) < 0.5
    # Where the gripper is between frames is interpolated; strands that touch make much of that.
    assert np.median(away[:, -1]) < 6.0
    assert away[:, -1].mean() < 12.0


@pytest.mark.slow
def test_mujoco_predicts_from_the_middle_of_a_drag(nominal_motions):
    now, model, motions = 8, mujoco_dynamics(), nominal_motions
    points, truth = motions.points[:, now], torch.from_numpy(motions.points[:, now + 1 :])
    given = [motions.grasped[:, now:-1], motions.gripper[:, now + 1 :]]
    speed = (points - motions.points[:, now - 1]) / STEP
    moving, halted = (
        1e3 * (model.predict(*map(torch.from_numpy, (points, one, *given))) - truth).norm(dim=-1)
        for one in (speed, np.zeros_like(speed))
    )
    moving, halted = moving.mean(-1).numpy(), halted.mean(-1).numpy()
    assert np.median(moving[:, 0]) < 1.0
    assert np.median(moving[:, -1]) < 8.0
    assert np.median(moving[:, 0] / halted[:, 0]) < 0.85


def test_mujoco_starts_with_the_vertex_velocities(rng):
    """Also where the head stands upright, about which it may have any roll."""
    upright = np.linspace(0, np.pi / 2, 12)[::-1]
    steps = np.zeros((40, 3))
    steps[:12, 0], steps[:12, 2], steps[12:, 0] = np.cos(upright), -np.sin(upright), 1.0
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]) / 40
    points[:, 2] += 0.1 - points[:, 2].min()  # in the air, so that nothing holds it
    velocities = np.zeros_like(points)
    velocities[:, 1] = np.where(np.arange(41) < 8, 0.3, 0.1) + 1e-4 * rng.normal(size=41)
    ahead = mujoco_dynamics().predict(
        torch.from_numpy(points)[None],
        torch.from_numpy(velocities)[None],
        torch.tensor([FREE]),
        torch.zeros(1, 1, 3),
    )
    moved = ahead[0, 0].numpy() - points
    assert 0.2 * 0.01 < moved[:, 1].mean() < 0.3 * STEP
    assert np.abs(moved).max() < 0.1


def test_diverged_simulation_stays_where_it_was(rng):
    points = ropes(rng, 2).double()
    velocities = torch.zeros_like(points)
    velocities[1] = torch.from_numpy(rng.normal(size=(41, 3))) * 1e5
    ahead = mujoco_dynamics().predict(points, velocities, torch.tensor([3, 3]), drag(points, 3, 2))
    torch.testing.assert_close(ahead[1], points[1].float().expand(2, -1, -1), atol=1e-4, rtol=0)
    assert (ahead[0, -1] - points[0].float()).norm(dim=-1).max() > 0.01


def test_saved_model_predicts_the_same(tmp_path, rng):
    model, points = LstmDynamics.load(), ropes(rng)
    model.save(tmp_path / "model.safetensors")
    again = LstmDynamics.load(tmp_path / "model.safetensors")
    arguments = points, torch.zeros_like(points), torch.full((3,), 4), drag(points, 4)
    torch.testing.assert_close(again.predict(*arguments), model.predict(*arguments))


@pytest.mark.usefixtures("two_threads")
def test_lstm_predicts_on_one_thread(rng):
    model, points, threads = LstmDynamics.load(), ropes(rng), []
    model.register_forward_hook(lambda *_: threads.append(torch.get_num_threads()))
    model.predict(points, torch.zeros_like(points), torch.full((3,), 4), drag(points, 4, steps=2))
    assert threads == [1, 1]
    assert torch.get_num_threads() == 2


class Carried:
    """Every vertex goes where the held link goes."""

    def predict(self, points, velocities, grasped, gripper):
        held = (grasped != FREE).float()[:, None, None]
        centre = (points[0, grasped] + points[0, grasped + 1]) / 2
        return points[:, None] + (held * (gripper - centre[:, None]))[:, :, None]


@pytest.mark.parametrize("seconds", [0.03, 0.1, 0.25])
def test_model_prediction_interpolates_in_time(seconds, rng):
    points = random_curve(RopeConfig(), rng)
    gripper = points[8:10].mean(axis=0) + [0.02, -0.01, 0.03]
    ahead = ModelPrediction(Carried())(points, np.zeros_like(points), seconds, gripper, 8)
    np.testing.assert_allclose(ahead, points + [0.02, -0.01, 0.03], atol=1e-6)
    free = ModelPrediction(Carried())(points, np.zeros_like(points), seconds, None, None)
    np.testing.assert_allclose(free, points, atol=1e-6)


def test_model_prediction_after_zero_seconds(rng):
    points = random_curve(RopeConfig(), rng)
    assert np.array_equal(ModelPrediction(Carried())(points, points, 0.0, points[3], 3), points)


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


def test_static_error_is_the_ropes_motion():
    table = prediction_errors({"still": StaticDynamics()}, drifting())
    assert list(table.columns) == ["model", "level", "steps", "motions", "mean_error_mm"]
    for row in table.itertuples():
        assert np.isclose(row.mean_error_mm, 10.0 * row.steps, atol=0.01)
        assert row.motions == 2
    assert sorted(set(table.level)) == [0, 1]


def test_model_knows_the_release():
    oracle = Oracle()
    table = prediction_errors({"oracle": oracle}, drifting())
    grasped = [20] * RELEASED + [FREE] * (FRAMES - 1 - RELEASED)
    assert oracle.asked == [([grasped] * 4, FRAMES - 1)]
    assert table.mean_error_mm.max() < 0.01

"""Training lowers the error, and goes on from where it was stopped as if it had not been."""

import numpy as np
import pytest
import torch

from knotflow.demonstrations import load_demonstrations
from knotflow.execution import FREE, DynamicsTraining, DynamicsTrainingConfig, draw_motions
from knotflow.execution.lstm import LstmConfig
from knotflow.execution.rope_motions import Motions, simulated_frames
from knotflow.simulation import RopeSimulator, SimulationConfig

SMALL = DynamicsTrainingConfig(
    network=LstmConfig(hidden=12), steps=40, batch=8, horizon=2, learning_rate=1e-2
)


@pytest.fixture(scope="module")
def motions():
    simulation = SimulationConfig(threads=1)
    drawn = draw_motions(load_demonstrations(), simulation, 2, 4, np.random.default_rng(0), (0, 2))
    return Motions.join(list(drawn))


def test_motions_are_of_ropes_that_are_dragged_and_then_free(motions):
    assert motions.points.shape[1:] == (26, 41, 3)
    assert set(motions.level) == {0, 2}
    dragged, free = motions.grasped[:, :18], motions.grasped[:, 18:]
    assert (dragged == dragged[:, :1]).all() and (dragged >= 0).all()
    assert (free == FREE).all()
    rows = np.arange(len(motions))
    held = motions.points[rows, 10, dragged[:, 10]] + motions.points[rows, 10, dragged[:, 10] + 1]
    np.testing.assert_allclose(held / 2, motions.gripper[:, 10], atol=0.04)


def test_frames_of_a_motion_are_a_step_apart_though_the_simulator_shows_them_early():
    """A frame read a time step later is what the next step's gripper has not yet moved."""
    frames = simulated_frames(np.array([0, 10, 20, 250]), 251)
    assert frames.tolist() == [0, 11, 21, 250]
    simulation = SimulationConfig(threads=1, record_rate=100.0)
    shown = load_demonstrations()[0]
    fine = RopeSimulator(simulation).execute(shown.points[None], shown.spline[None])
    coarse = RopeSimulator(SimulationConfig(threads=1)).execute(
        shown.points[None], shown.spline[None]
    )
    # The gripper comes to rest with its last time step, and the rope trails by what it shows early.
    np.testing.assert_array_equal(coarse.trajectory[:, 1:], fine.trajectory[:, 10::10])
    link = int(shown.spline[0] * 40)
    away = [
        np.linalg.norm(
            rope[:, link : link + 2].mean(1) - fine.gripper[0, 20:160:10], axis=-1
        ).mean()
        for rope in (fine.trajectory[0, 20:160:10], fine.trajectory[0, 21:161:10])
    ]
    speed = np.linalg.norm(np.diff(fine.gripper[0, 20:160], axis=0), axis=-1).mean()
    np.testing.assert_allclose(away[0] - away[1], speed, rtol=0.3)


def test_a_file_of_motions_is_read_as_it_was_written(motions, tmp_path):
    motions.save(tmp_path / "motions.npz")
    read = Motions.load(tmp_path / "motions.npz")
    for name, value in vars(motions).items():
        np.testing.assert_array_equal(getattr(read, name), value)


def test_training_lowers_the_error(motions):
    errors = list(DynamicsTraining(motions, SMALL, seed=0))
    assert len(errors) == SMALL.steps
    assert np.mean(errors[-10:]) < 0.9 * errors[0]


def test_a_training_that_goes_on_ends_as_one_without_a_pause(motions, tmp_path):
    whole = DynamicsTraining(motions, SMALL, seed=0)
    list(whole)
    first = DynamicsTraining(motions, SMALL, seed=0)
    for _ in range(15):
        next(iter(first))
    first.save(tmp_path / "training.pt")
    rest = DynamicsTraining(motions, SMALL, seed=99)
    rest.load(tmp_path / "training.pt")
    list(rest)
    for one, other in zip(whole.model.parameters(), rest.model.parameters(), strict=True):
        torch.testing.assert_close(one, other)

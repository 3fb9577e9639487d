"""Motions are of ropes that are dragged and let go."""

import numpy as np

from knotflow.execution import FREE, Motions, draw_motions
from knotflow.execution.motions import simulated_frames
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.simulation import RopeSimulator, SimulationConfig


def test_ropes_are_dragged_then_free(motions):
    assert motions.points.shape[1:] == (26, 41, 3)
    assert set(motions.level) == {0, 2}
    dragged, free = motions.grasped[:, :18], motions.grasped[:, 18:]
    assert (dragged == dragged[:, :1]).all() and (dragged >= 0).all()
    assert (free == FREE).all()
    rows = np.arange(len(motions))
    held = motions.points[rows, 10, dragged[:, 10]] + motions.points[rows, 10, dragged[:, 10] + 1]
    np.testing.assert_allclose(held / 2, motions.gripper[:, 10], atol=0.04)


def test_frames_correct_the_simulators_early_recording():
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


def test_save_and_load(motions, tmp_path):
    motions.save(tmp_path / "motions.npz")
    read = Motions.load(tmp_path / "motions.npz")
    for name, value in vars(motions).items():
        np.testing.assert_array_equal(getattr(read, name), value)


def test_half_of_the_motions_are_consecutive():
    simulation = SimulationConfig(threads=1)
    drawn = draw_motions(load_demonstrations(), simulation, 0, 4, np.random.default_rng(1))
    assert len(drawn) == 4
    before, after = drawn.points[2:]
    apart = after[0] - before[-1]
    np.testing.assert_allclose(apart, np.broadcast_to(apart[:1], apart.shape), atol=1e-5)

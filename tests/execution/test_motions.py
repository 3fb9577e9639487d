"""Motions are of ropes that are dragged and let go."""

import numpy as np

from knotflow.execution import FREE, Motions, draw_motions
from knotflow.execution.motions import simulated_frames
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.simulation import RopeSimulator, SimulationConfig


def test_ropes_are_dragged_then_free(motions):
    assert motions.points.shape[2:] == (41, 3)
    assert set(motions.level) == {0, 2}
    free = motions.grasped == FREE
    assert (
        (np.diff(free.astype(int), axis=1) >= 0).all()
        and not free[:, 0].any()
        and free[:, -1].all()
    )
    link = motions.grasped[:, :1]
    assert (np.where(free, link, motions.grasped) == link).all()
    rows, link, middle = np.arange(len(motions)), link[:, 0], (~free).sum(axis=1) // 2
    held = motions.points[rows, middle, link] + motions.points[rows, middle, link + 1]
    np.testing.assert_allclose(held / 2, motions.gripper[rows, middle], atol=0.02)


def test_frames_correct_the_simulators_early_recording():
    """A frame read a time step later is what the next step's gripper has not yet moved."""
    frames = simulated_frames(np.array([0, 10, 20, 250]), 251)
    assert frames.tolist() == [0, 11, 21, 250]
    simulation = SimulationConfig(threads=1, record_rate=50.0)
    shown = load_demonstrations()[0]
    fine = RopeSimulator(simulation).execute(shown.points[None], shown.spline[None])
    coarse = RopeSimulator(SimulationConfig(threads=1)).execute(
        shown.points[None], shown.spline[None]
    )
    # The gripper comes to rest with its last time step, and the rope trails by what it shows early.
    np.testing.assert_array_equal(coarse.trajectory[:, 1:], fine.trajectory[:, 5::5])
    link = int(shown.spline[0] * 40)
    away = [
        np.linalg.norm(rope[:, link : link + 2].mean(1) - fine.gripper[0, 20:80:5], axis=-1).mean()
        for rope in (fine.trajectory[0, 20:80:5], fine.trajectory[0, 21:81:5])
    ]
    speed = np.linalg.norm(np.diff(fine.gripper[0, 20:80], axis=0), axis=-1).mean()
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

"""The demonstrator, its noise, and the trials everything learns from."""

import numpy as np
import pytest

from knotflow.samplers.demonstrations import (
    DemonstrationError,
    Demonstrator,
    DemonstratorConfig,
    NoiseConfig,
    load_demonstrations,
    load_trials,
    noisy_copies,
    scripted,
    task,
)
from knotflow.simulation import SPLINE_HIGH, Trials, attempt, check_splines, straight
from knotflow.topology import TopologicalState, parse_action


def succeed(points, splines, one, simulator):
    """Which splines (N, 6) bring the rope to the task's goal state."""
    return attempt(simulator, points, splines, one.action, one.start_state).success


@pytest.mark.slow
def test_a_demonstration_bears_its_noise(simulator, rng):
    points, one = straight(simulator.config.rope), task("R1(0,1,1)")
    seen = []
    config = DemonstratorConfig(iterations=2, finalists=1, room_guesses=6)
    found = Demonstrator(one, simulator, rng, config, observe=seen.append).demonstrate(points)
    assert found is not None
    assert 0 < found.clearance < 1 and found.success_rate >= config.least_share
    assert succeed(points, found.spline[None], one, simulator).all()
    assert TopologicalState.from_curve(found.end) == one.goal_state
    copies = noisy_copies(found.spline, 48, np.random.default_rng(99), config.noise)
    assert succeed(points, copies, one, simulator).mean() > 0.4
    followers = sum(len(tried) for tried in seen if tried.start == one.goal_state)
    assert followers == len(scripted.next_actions(one, rng)) * config.room_guesses


def test_without_iterations_the_first_success_is_kept(simulator, rng):
    points, one = straight(simulator.config.rope), task("R1(0,1,1)")
    seen = []
    config = DemonstratorConfig(iterations=0, least_share=0.0, room_guesses=1)
    found = Demonstrator(one, simulator, rng, config, observe=seen.append).demonstrate(points)
    hits = np.concatenate([tried.splines[tried.success] for tried in seen if len(tried) == 32])
    np.testing.assert_allclose(found.spline, hits[0], atol=1e-6)
    assert succeed(points, found.spline[None], one, simulator).all()


def test_no_hit_is_no_demonstration(simulator, rng, monkeypatch):
    """A demonstrator whose every guess leaves the rope alone has nothing to show."""
    points = straight(simulator.config.rope)
    stay = np.array([0.5, *points[20, :2], 0.02, *points[20, :2]])
    monkeypatch.setattr(
        scripted, "heuristic_splines", lambda points, action, count, rng: np.tile(stay, (count, 1))
    )
    config = DemonstratorConfig(guesses=4)
    assert Demonstrator(task("R1(0,1,1)"), simulator, rng, config).demonstrate(points) is None


@pytest.mark.slow
def test_shipped_demonstrations_work_as_they_are(simulator):
    """Physics and demonstrations belong together.

    A rope makes much of the last bits in which machines differ: two of fifty may fail.
    """
    failed = [
        number
        for number, one in enumerate(load_demonstrations())
        if not succeed(one.points, one.spline[None], one.task, simulator).all()
    ]
    assert len(failed) <= 2, f"demonstrations {failed} fail (counted from 0)"


@pytest.mark.slow
@pytest.mark.parametrize("action", ["R1(0,1,1)", "R2(0,0,1,1)"])
def test_shipped_demonstrations_from_the_straight_rope_work(simulator, action, rng):
    (one,) = (d for d in load_demonstrations() if str(d.task.action) == action)
    copies = noisy_copies(one.spline, 32, rng, NoiseConfig())
    assert succeed(one.points, copies, one.task, simulator).mean() > 0.3


def test_noise_has_its_spread_and_stays_in_range():
    config = NoiseConfig(grasp=0.01, middle=0.02, end=0.03)
    spline = np.array([0.5, 0.0, 0.0, 0.15, 0.0, 0.0])
    copies = noisy_copies(spline, 20_000, np.random.default_rng(0), config)
    np.testing.assert_allclose(copies.std(axis=0), [0.01, 0.02, 0.02, 0.02, 0.03, 0.03], rtol=0.05)
    np.testing.assert_allclose(copies.mean(axis=0), spline, atol=1e-3)
    check_splines(noisy_copies(SPLINE_HIGH, 100, np.random.default_rng(0), config))


def make_trials(action="R1(0,1,1)", count=5, seed=0):
    rng = np.random.default_rng(seed)
    return Trials(
        parse_action(action),
        TopologicalState.trivial(),
        rng.normal(size=(count, 41, 3)),
        rng.normal(size=(count, 6)),
        rng.random(count) < 0.5,
    )


def test_trials_are_loaded_by_action(tmp_path):
    (tmp_path / "trials").mkdir()
    parts = [make_trials(seed=1), make_trials(seed=2), make_trials("R2(0,0,1,1)", seed=3)]
    for number, part in enumerate(parts):
        part.save(tmp_path / "trials" / f"{number}.npz")
    loaded = load_trials(tmp_path)
    assert {str(action): len(some) for action, some in loaded.items()} == {
        "R1(0,1,1)": 2,
        "R2(0,0,1,1)": 1,
    }
    for part, read in zip(parts, [one for some in loaded.values() for one in some], strict=True):
        assert (read.action, read.start) == (part.action, part.start)
        for name in ("points", "splines", "success"):
            assert np.array_equal(getattr(read, name), getattr(part, name))


def test_an_action_without_trials_is_named_with_those_there_are(tmp_path):
    (tmp_path / "trials").mkdir()
    make_trials().save(tmp_path / "trials" / "0.npz")
    loaded = load_trials(tmp_path)
    missing = parse_action("C(0,1,1)")
    assert loaded.get(missing) is None
    with pytest.raises(DemonstrationError, match=r"of C\(0,1,1\), only of R1\(0,1,1\); .* merge"):
        loaded[missing]


def test_a_folder_without_trials_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match="no trials"):
        load_trials(tmp_path)

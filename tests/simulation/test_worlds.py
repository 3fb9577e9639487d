"""Worlds are drawn from their stated ranges, and the nominal one is exact."""

from dataclasses import fields, replace

import numpy as np
import pytest

from knotflow.simulation import (
    EXPONENTS,
    GRASP_REACH,
    LEVELS,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    World,
    WorldsConfig,
    control_points,
    draw_worlds,
    perturb_rope,
    random_trials,
    straight,
)


def test_level_0_changes_nothing(rng):
    assert perturb_rope(RopeConfig(), 0, rng) == RopeConfig()


@pytest.mark.parametrize("level", LEVELS)
def test_factors_are_log_uniform(level, rng):
    rope = RopeConfig()
    drawn = [perturb_rope(rope, level, rng) for _ in range(400)]
    for field in fields(rope):
        values = [getattr(one, field.name) for one in drawn]
        if field.name not in EXPONENTS:
            assert set(values) == {getattr(rope, field.name)}
            continue
        logs = np.log(np.array(values) / getattr(rope, field.name))
        widest = level * EXPONENTS[field.name]
        assert np.abs(logs).max() <= widest + 1e-12
        assert logs.std() == pytest.approx(widest / np.sqrt(3), rel=0.1, abs=1e-12)


def test_unknown_level_is_rejected(rng):
    with pytest.raises(ValueError, match="unknown level 3; valid levels: 0, 1, 2"):
        perturb_rope(RopeConfig(), 3, rng)


SIMULATION = SimulationConfig(pace=1.0, threads=2)


@pytest.fixture(scope="module")
def fast():
    return RopeSimulator(SIMULATION)


def trials(count, rng):
    return random_trials(SIMULATION.rope, count, rng)


def test_nominal_worlds_are_the_simulator_to_the_last_bit(fast, rng):
    points, splines = trials(5, rng)
    nominal = RopeSimulator(SIMULATION).execute(points, splines)
    other = World(perturb_rope(RopeConfig(), 2, rng), 0.7, (0.01, 0.0), (0.0, 0.01))
    mixed = fast.execute(points, splines, [World(), other, World(), other, World()])
    after = fast.execute(points, splines)
    np.testing.assert_array_equal(mixed.end_points[::2], nominal.end_points[::2])
    np.testing.assert_array_equal(after.end_points, nominal.end_points)
    assert (np.abs(mixed.end_points[1::2] - nominal.end_points[1::2]).max(axis=(1, 2)) > 1e-3).all()


def test_world_has_the_motion_of_its_own_simulator(fast, rng):
    points, splines = trials(3, rng)
    world = World(perturb_rope(RopeConfig(), 2, rng), 0.6)
    own = RopeSimulator(replace(SIMULATION, rope=world.rope, pace=0.6)).execute(points, splines)
    found = fast.execute(points, splines, [world] * 3)
    np.testing.assert_array_equal(found.release_times, own.release_times)
    np.testing.assert_allclose(found.trajectory[:, :10], own.trajectory[:, :10], atol=2e-3)


def test_fingers_catch_the_nearest_link_or_none(rng):
    points = straight(RopeConfig())
    controls = np.array([[0.0125, 0.0, 0.005], [0.1, 0.2, 0.1], [0.1, 0.3, 0.005]])
    link, moved = World(grasp=(0.05, 0.01), shift=(0.0, 0.02)).disturb(points, controls)
    assert link == 22
    np.testing.assert_allclose(moved[:, 0] - controls[:, 0], 0.05, atol=1e-9)
    np.testing.assert_allclose(moved[:, 1] - controls[:, 1], [0.0, 0.02, 0.02], atol=1e-9)
    assert World(grasp=(0.0, 2 * GRASP_REACH)).disturb(points, controls)[0] is None
    wider = World(grasp=(0.0, 2 * GRASP_REACH), reach=3 * GRASP_REACH)
    assert wider.disturb(points, controls)[0] is not None


def test_rope_that_is_not_caught_stays(fast):
    points = straight(RopeConfig())
    spline = np.array([0.5, 0.1, 0.2, 0.1, 0.1, 0.3])
    missed = World(grasp=(0.0, 2 * GRASP_REACH))
    ends = fast.execute(points[None], spline[None], [missed]).end_points
    np.testing.assert_allclose(ends[0], points, atol=2e-3)


def test_drawn_worlds_lie_in_their_ranges(rng):
    config = WorldsConfig(level=1, slowest=0.5, fastest=2.0, error=0.006)
    worlds = draw_worlds(RopeConfig(), 400, rng, config)
    pace = np.log2([world.pace for world in worlds])
    assert np.abs(pace).max() <= 1
    assert pace.std() == pytest.approx(1 / np.sqrt(3), rel=0.1)
    assert np.std([world.grasp for world in worlds]) == pytest.approx(0.006, rel=0.1)
    assert np.std([world.shift for world in worlds]) == pytest.approx(0.006 * 2**0.5, rel=0.1)
    exact = draw_worlds(RopeConfig(), 2, rng, WorldsConfig(0, 1.0, 1.0))
    assert exact == [World(), World()]


def test_a_planned_motion_is_executed_blindly(fast, rng):
    points, splines = trials(3, rng)
    controls = control_points(points, splines, SIMULATION.rope.radius)
    worlds = [World()] * 3
    planned = fast.execute(points, splines, worlds)
    blind = fast.execute(points, splines, worlds, controls)
    np.testing.assert_allclose(blind.gripper, planned.gripper, atol=1e-6)
    away = points + [10 * GRASP_REACH, 0.0, 0.0]
    missed = fast.execute(away, splines, worlds, controls)
    untouched = np.abs(missed.end_points - away).max(axis=(1, 2)) < 5e-3
    assert untouched.any()


def test_worlds_have_the_simulators_rope_and_one_is_a_spline_s(fast, rng):
    points, splines = trials(2, rng)
    with pytest.raises(ValueError, match="2 splines need as many worlds, got 1"):
        fast.execute(points, splines, [World()])
    with pytest.raises(ValueError, match="a world's rope is 2 m in 80 links, but .* 1 m in 40"):
        fast.execute(points, splines, [World(RopeConfig(length=2.0, links=80))] * 2)


@pytest.mark.parametrize(
    "values", [{"slowest": 0.0}, {"slowest": 3.0}, {"fastest": np.inf}, {"error": -1.0}]
)
def test_ranges_that_nothing_can_be_drawn_from_are_refused(values):
    with pytest.raises(ValueError, match="of worlds"):
        WorldsConfig(**values)


def test_an_unknown_level_is_named_before_anything_is_drawn():
    with pytest.raises(ValueError, match="unknown level 3; valid levels: 0, 1, 2"):
        WorldsConfig(level=3)

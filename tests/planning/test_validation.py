"""Steps simulated again, and strands that pass through others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import (
    PlanStep,
    check_steps,
    find_penetrations,
    validation,
)
from knotflow.samplers.demonstrations import SHIPPED, Demonstration, load_demonstrations
from knotflow.simulation import RopeSimulator, SimulationConfig, attempt, straight
from knotflow.topology import TopologicalState

SIMULATION = SimulationConfig(threads=1)


@pytest.fixture(scope="module")
def steps():
    """A shipped demonstration from each of three start states, as steps of a plan."""
    found = {}
    for one in load_demonstrations(SHIPPED):
        if one.task.start_state not in found and len(found) < 3:
            found[one.task.start_state] = step_of(one)
    return [*found.values()]


def step_of(shown: Demonstration) -> PlanStep:
    """A demonstration as a step of a plan."""
    task = shown.task
    tried = attempt(
        RopeSimulator(SIMULATION), shown.points, shown.spline[None], task.action, task.start_state
    )
    rollouts = tried.rollouts
    return PlanStep(
        task.action, shown.spline, shown.points, task.start_state, rollouts.end_points[0],
        tried.ends[0], **vars(rollouts.motion(0)),
    )  # fmt: skip


@pytest.mark.slow
def test_reliable_steps_pass(steps):
    checks = check_steps(steps, SIMULATION)
    assert [check.reproduced for check in checks] == [True] * 3
    assert [len(check.penetrations) for check in checks] == [0] * 3
    assert all(check.steady for check in checks)


@pytest.mark.slow
def test_step_that_jumps_is_checked_for_its_state_and_not_its_action(steps):
    others = (one for one, end in steps[1].start_state.actions() if end != steps[1].end_state)
    jump = replace(steps[1], action=next(others))
    assert jump.jumps and not steps[1].jumps
    (check,) = check_steps([jump], SIMULATION)
    assert check.reproduced


@pytest.mark.slow
def test_step_that_misses_its_state_is_found(steps, monkeypatch):
    wrong = replace(steps[1], end_state=TopologicalState.parse("1o4+2o3-"))
    monkeypatch.setattr(validation, "CHUNK", 2)  # the checks stay in order across batches
    checks = check_steps([steps[0], wrong, steps[2]], SIMULATION)
    assert [(check.reproduced, check.steady) for check in checks] == [
        (True, True), (False, False), (True, True),
    ]  # fmt: skip


def test_knot_that_comes_undone_by_itself_is_not_robust(monkeypatch):
    """The shipped demonstration whose rope unbends until its end slips back."""
    step = step_of(load_demonstrations(SHIPPED)[15])
    assert validation.are_robust([step], SIMULATION) == [False]
    monkeypatch.setattr(validation, "HOLD_TIME", 0.0)
    assert validation.are_robust([step], SIMULATION) == [True]


@pytest.mark.slow
def test_penetrations_are_reported_with_their_step(steps, monkeypatch):
    penetration = (7, 0.1, 0.6)

    def penetrations(trajectory):
        started_as = [np.allclose(trajectory[0], step.start, atol=1e-3) for step in steps]
        number = started_as.index(True)
        every = np.arange(len(trajectory)) * SIMULATION.timestep
        assert every[-1] == pytest.approx(steps[number].times[-1], abs=0.5)  # a frame a time step
        return [penetration] if number == 1 else []

    monkeypatch.setattr(validation, "find_penetrations", penetrations)
    checks = check_steps(steps, SIMULATION)
    assert [check.penetrations for check in checks] == [[], [penetration], []]


def loop(height: float, cross: float = 0.1) -> np.ndarray:
    """A rope (41, 3) whose tail passes `height` above its head, `cross` metres beyond it."""
    corners = [(0.0, 0.0), (0.4, 0.0), (0.4, 0.3), (0.2, 0.3), (0.2, -cross)]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.linspace(0, along[-1] - 1e-4, 41)
    points = np.zeros((41, 3))
    for axis in (0, 1):
        points[:, axis] = np.interp(at, along, np.array(corners)[:, axis])
    points[-16:, 2] = height
    points[:, :2] += 1e-4 * np.arange(41)[:, None]  # nothing lies exactly on anything
    return points


def test_strands_that_keep_their_order_do_not_penetrate():
    trajectory = np.stack([loop(0.016 + 0.002 * frame) for frame in range(8)])
    assert len(find_penetrations(trajectory)) == 0


def test_penetration_is_located_in_time_and_along_rope():
    trajectory = np.stack([loop(0.02 - 0.005 * frame) for frame in (0, 1, 2, 3, 5, 6)])
    ((frame, first, second),) = find_penetrations(trajectory)
    assert frame == 4
    assert first < second
    mirrored = find_penetrations(trajectory * [1, -1, 1])
    assert mirrored[:, 0].tolist() == [4]
    reversed_ = find_penetrations(trajectory[:, ::-1])
    np.testing.assert_allclose(sorted(reversed_[0, 1:]), [1 - second, 1 - first], atol=1e-12)


def test_moving_an_end_under_is_no_penetration():
    over = [loop(0.016, cross) for cross in (0.10, 0.06, 0.02, -0.02, -0.06)]
    under = [loop(-0.016, cross) for cross in (-0.06, -0.02, 0.02, 0.06)]
    assert len(find_penetrations(np.stack([*over, *under]))) == 0


def test_crossings_elsewhere_or_of_the_other_turn_are_others():
    before = loop(0.016)
    assert len(find_penetrations(np.stack([before, loop(-0.016)]))) == 1
    assert len(find_penetrations(np.stack([before, loop(-0.016, cross=0.4)]))) == 0
    assert len(find_penetrations(np.stack([before, loop(-0.016) * [1, -1, 1]]))) == 0


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_simulated_rope_does_not_penetrate_itself(rate):
    simulator = RopeSimulator(SimulationConfig(threads=1, record_rate=rate))
    rope = straight(simulator.config.rope)
    splines = np.array([[0.02, 0.3, 0.25, 0.2, 0.1, -0.15], [0.98, -0.3, 0.25, 0.2, -0.1, -0.15]])
    for trajectory in simulator.execute(np.stack([rope, rope]), splines).trajectory:
        assert len(find_penetrations(trajectory)) == 0

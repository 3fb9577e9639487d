"""A step that is simulated again is judged by what it does, not by what the plan says of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import PlanStep, StrandPassage, check_steps, soundness
from knotflow.samplers.demonstrations import SHIPPED, Demonstration, load_demonstrations
from knotflow.simulation import RopeSimulator, SimulationConfig, attempt
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
        tried.ends[0], rollouts.times, rollouts.trajectory[0], rollouts.gripper[0],
    )  # fmt: skip


@pytest.mark.slow
def test_sound_steps_pass(steps):
    checks = check_steps(steps, SIMULATION)
    assert [check.reproduced for check in checks] == [True] * 3
    assert [check.passages for check in checks] == [()] * 3
    assert all(check.steady for check in checks)


@pytest.mark.slow
def test_a_step_that_does_not_reach_its_state_is_found(steps, monkeypatch):
    wrong = replace(steps[1], end_state=TopologicalState.parse("1o4+2o3-"))
    monkeypatch.setattr(soundness, "AT_ONCE", 2)  # the checks stay in order across batches
    checks = check_steps([steps[0], wrong, steps[2]], SIMULATION)
    assert [(check.reproduced, check.steady) for check in checks] == [
        (True, True), (False, False), (True, True),
    ]  # fmt: skip


def test_a_knot_that_comes_undone_by_itself_is_not_steady(monkeypatch):
    """The shipped demonstration whose rope unbends until its end slips back."""
    step = step_of(load_demonstrations(SHIPPED)[40])
    assert soundness.are_steady([step], SIMULATION) == [False]
    monkeypatch.setattr(soundness, "HELD", 0.0)
    assert soundness.are_steady([step], SIMULATION) == [True]


@pytest.mark.slow
def test_what_passed_through_is_told_of_its_own_step(steps, monkeypatch):
    passage = StrandPassage(7, (0.1, 0.6))

    def passages(trajectory):
        every = np.arange(len(trajectory)) * SIMULATION.timestep
        assert every[-1] == pytest.approx(steps[0].times[-1], abs=0.5)  # a frame a time step
        started_as = [np.allclose(trajectory[0], step.start, atol=1e-3) for step in steps]
        return [passage] if started_as.index(True) == 1 else []

    monkeypatch.setattr(soundness, "find_passages", passages)
    checks = check_steps(steps, SIMULATION)
    assert [check.passages for check in checks] == [(), (passage,), ()]

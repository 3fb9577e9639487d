"""One short plan: a loop in a straight rope."""

import numpy as np
import pytest

from knotflow.demonstrations import load_demonstrations
from knotflow.planning import KnotPlan, PlanStep
from knotflow.simulation import state_or_none


@pytest.fixture(scope="session")
def plan(simulator):
    """A plan of one step, R1(0,1,1), that works in the planner's simulator."""
    shown = load_demonstrations()[0]
    rollouts = simulator.execute(shown.points[None], shown.spline[None])
    end = rollouts.end_points[0]
    step = PlanStep(
        action=shown.task.action,
        spline=shown.spline,
        start=shown.points,
        start_state=shown.task.start_state,
        end=end,
        end_state=state_or_none(end),
        times=rollouts.times,
        trajectory=rollouts.trajectory[0],
        gripper=rollouts.gripper[0],
    )
    return KnotPlan(
        goal="a loop",
        goal_states=(step.end_state,),
        solved=True,
        reason="the goal was reached",
        start=step.start,
        start_state=step.start_state,
        steps=(step,),
        tried=(),
        branches=1,
        nodes=2,
        seconds=0.0,
        sampling_seconds=0.0,
        simulation_seconds=0.0,
        radius=simulator.config.rope.radius,
        move_time=simulator.config.move_time,
    )


@pytest.fixture
def points(plan):
    return np.array(plan.start)

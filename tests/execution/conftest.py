"""Plans: one that was not simulated, two splines on a straight rope; one that makes a loop. An arm
from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from knotflow.execution import Motions, draw_motions
from knotflow.planning import KnotPlan, PlanStep
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.simulation import (
    RopeConfig,
    SimulationConfig,
    control_points,
    spline_path,
    state_or_none,
    straight,
)
from knotflow.topology import TopologicalState, parse_action

ROPE = RopeConfig()
MOVE_TIME = 1.8

SPLINES = (
    [0.25, -0.1, 0.15, 0.1, -0.05, 0.15],
    [0.75, 0.1, -0.2, 0.12, 0.05, -0.2],
)

SCARA = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="shoulder" pos="0 0 0.4">
      <joint name="shoulder" axis="0 0 1" range="-3 3" limited="true"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0.45 0 0" size="0.03"/>
      <body name="elbow" pos="0.45 0 0">
        <joint name="elbow" axis="0 0 1" range="-2.8 2.8" limited="true"/>
        <geom name="lower" type="capsule" fromto="0 0 0 0.45 0 0" size="0.03"/>
        <body name="quill" pos="0.45 0 -0.1">
          <joint name="lift" type="slide" axis="0 0 1" range="-0.25 0.1" limited="true"/>
          <joint name="wrist" axis="0 0 1" range="-6 6" limited="true"/>
          <geom name="quill" type="capsule" fromto="0 0 0.05 0 0 -0.05" size="0.01"/>
          <site name="fingers" pos="0 0 -0.065" quat="0 1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <keyframe><key qpos="0.5 -1.0 -0.05 0"/></keyframe>
</mujoco>
"""
"""Four joints, so its gripper always points down; the tip is 0.235 m above the table at rest."""


def plan_of(splines) -> KnotPlan:
    """A plan whose gripper follows the splines over a rope that stays where it is."""
    points, state = straight(ROPE), TopologicalState.trivial()
    times = np.linspace(0.0, MOVE_TIME, 19)
    u = times / MOVE_TIME
    steps = []
    for spline in splines:
        controls = control_points(points, np.array(spline), ROPE.radius)
        steps.append(
            PlanStep(
                action=parse_action("R1(0,1,1)"),
                spline=np.array(spline),
                start=points,
                start_state=state,
                end=points,
                end_state=state,
                times=times,
                trajectory=np.repeat(points[None], len(times), axis=0).astype(np.float32),
                gripper=spline_path(controls, u**2 * (3 - 2 * u)).astype(np.float32),
                release_time=MOVE_TIME,
            )
        )
    return KnotPlan(
        goal="test",
        goal_states=(state,),
        solved=True,
        reason="it is a test",
        start=points,
        start_state=state,
        steps=tuple(steps),
        tried=(),
        branches=2,
        kept=2,
        seconds=0.0,
        radius=ROPE.radius,
    )


@pytest.fixture(scope="session")
def still() -> KnotPlan:
    return plan_of(SPLINES)


@pytest.fixture
def scara(tmp_path: Path) -> Path:
    path = tmp_path / "scara.xml"
    path.write_text(SCARA)
    return path


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
        **vars(rollouts.motion(0)),
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
        kept=1,
        seconds=0.0,
        radius=simulator.config.rope.radius,
    )


@pytest.fixture
def points(plan):
    return np.array(plan.start)


@pytest.fixture(scope="session")
def motions():
    """Eight motions of two ropes, like the planner's and unlike it."""
    simulation = SimulationConfig(threads=1)
    demonstrations, rng = load_demonstrations(), np.random.default_rng(0)
    return Motions.join(
        [draw_motions(demonstrations, simulation, level, 4, rng) for level in (0, 2)]
    )

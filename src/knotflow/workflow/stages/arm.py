"""Stage `arm`: plans as joint trajectories of an arm, checked by its forward kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from knotflow.execution import Arm, Export, export_plan, panda
from knotflow.planning import PlannerConfig, parse_goal, plan_knot
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, random_curve
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage

TABLE = "trajectories.csv"
BETWEEN = 4
"""Configurations checked from one waypoint to the next, where joints move evenly."""


@dataclass(kw_only=True)
class ArmConfig:
    """Which plans an arm follows, and how fast."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The planner's simulator."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a random rope looks like."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """Who proposes splines; the stages it learns from are inputs of this one."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """How plans are found."""
    knot: str = "overhand"
    """What is tied, by name."""
    plans: int
    """How many, each from a random rope of its own."""
    max_speed: float = 0.25
    """Of the tip, metres per second."""
    seed: int
    """Of ropes and plans; used for nothing else."""


@stage("arm")
def follow_plans(config: ArmConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes trajectories.csv, a row a plan.

    Inputs: what the sampler needs.
    """
    names = [f"{number:03d}" for number in range(config.plans)]
    context.table(TABLE, partial(_follow, config, dict(inputs)), names, "plans")


def _follow(
    config: ArmConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> pd.DataFrame:
    number = int(name)
    goal = parse_goal(config.knot, config.simulation.rope)
    points = random_curve(
        config.simulation.rope, np.random.default_rng([config.seed, number, 0]), config.starts
    )
    plan = plan_knot(
        points,
        goal,
        build_sampler(config.sampler, inputs),
        RopeSimulator(config.simulation),
        np.random.default_rng([config.seed, number, 1]),
        config.planner,
    )
    row: dict[str, Any] = {"plan": number, "knot": config.knot, "solved": plan.solved}
    if plan.solved:
        arm = panda()
        row |= check(arm, export_plan(plan, arm, max_speed=config.max_speed))
    return pd.DataFrame([row], columns=COLUMNS)


COLUMNS = [
    *("plan", "knot", "solved", "waypoints", "unreached", "tip_error_mm", "tip_speed"),
    *("limit_margin_deg", "joint_speed_share", "seconds", "slowed"),
]


def check(arm: Arm, export: Export) -> dict[str, float]:
    """What an exported trajectory is like, by the arm's own forward kinematics.

    Errors are of the waypoints that it says it reaches; `limit_margin_deg` is how far any joint
    stays from the ends of its range, degrees.
    """
    trajectory = export.trajectory
    joints, times = trajectory.ik.joints, trajectory.times
    even = np.linspace(0.0, 1.0, BETWEEN, endpoint=False)
    fine = (times[:-1, None] + np.diff(times)[:, None] * even).ravel()
    passed = np.stack([np.interp(fine, times, joint) for joint in joints.T], axis=1)
    tips, (low, high) = arm.tip_positions(passed), arm.joint_ranges()
    error = np.linalg.norm(arm.tip_positions(joints) - trajectory.waypoints.positions, axis=1)
    speeds = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(fine)
    margin = np.minimum(joints - low, high - joints).min()
    return {
        "waypoints": len(times),
        "unreached": len(trajectory.unreachable),
        "tip_error_mm": round(1e3 * float(error[trajectory.ik.ok].max(initial=0.0)), 3),
        "tip_speed": round(float(speeds.max()), 4),
        "limit_margin_deg": round(float(np.rad2deg(margin)), 2),
        "joint_speed_share": round(trajectory.peaks()["joint_speed"], 3),
        "seconds": round(float(times[-1]), 1),
        "slowed": round(export.slowed, 2),
    }

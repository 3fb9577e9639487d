"""Plans as joint trajectories of an arm, checked by its forward kinematics (Sec. VII-D)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from knotflow.execution import Arm, Export, export_plan, panda
from knotflow.experiments.common import sampler_of
from knotflow.planning import PlannerConfig, parse_goal, plan_knot
from knotflow.samplers import SamplerConfig
from knotflow.seeding import rng_of
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, random_curve
from knotflow.workflow import StageRun, stage

CHECKED_BETWEEN = 4
"""Configurations checked from one waypoint to the next, where joints move evenly."""
COLUMNS = [
    *("plan", "knot", "solved", "waypoints", "unreached", "tip_error_mm", "tip_speed"),
    *("limit_margin_deg", "joint_speed_share", "seconds", "slowed"),
]


@stage
def arm(
    run: StageRun,
    *,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    knot: str = "overhand",
    plans: int,
    max_speed: float,
    seed: int,
) -> None:
    """Plans from random ropes, followed by the arm. Makes trajectories.csv, a row a plan.

    `max_speed` is of the tip, metres per second.
    """
    rope = simulation.rope

    def follow(name: str) -> pd.DataFrame:
        number, simulator = int(name), RopeSimulator(simulation)
        points = random_curve(rope, rng_of(seed, number, 0), starts)
        proposer, rng = sampler_of(sampler, primitives=primitives), rng_of(seed, number, 1)
        plan = plan_knot(points, parse_goal(knot, rope), proposer, simulator, rng, planner)
        row: dict[str, Any] = {"plan": number, "knot": knot, "solved": plan.solved}
        if plan.solved:
            follower = panda()
            row |= check(follower, export_plan(plan, follower, max_speed=max_speed))
        return pd.DataFrame([row], columns=COLUMNS)

    run.table("trajectories.csv", follow, [f"{number:03d}" for number in range(plans)], "plans")


def check(arm: Arm, export: Export) -> dict[str, float]:
    """Measures of an exported trajectory, by the arm's own forward kinematics.

    Errors are of the waypoints that it says it reaches; `limit_margin_deg` is how far any joint
    stays from the ends of its range, degrees.
    """
    trajectory = export.trajectory
    joints, times = trajectory.ik.joints, trajectory.times
    even = np.linspace(0.0, 1.0, CHECKED_BETWEEN, endpoint=False)
    fine = (times[:-1, None] + np.diff(times)[:, None] * even).ravel()
    passed = np.stack([np.interp(fine, times, joint) for joint in joints.T], axis=1)
    tips, model = arm.tip_positions(passed), arm.model()
    low, high = model.jnt_range[arm.joint_ids(model)].T
    error = np.linalg.norm(arm.tip_positions(joints) - trajectory.waypoints.positions, axis=1)
    speeds = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(fine)
    margin = np.minimum(joints - low, high - joints).min()
    return {
        "waypoints": len(times),
        "unreached": int((~trajectory.ik.ok).sum()),
        "tip_error_mm": round(1e3 * float(error[trajectory.ik.ok].max(initial=0.0)), 3),
        "tip_speed": round(float(speeds.max()), 4),
        "limit_margin_deg": round(float(np.rad2deg(margin)), 2),
        "joint_speed_share": round(trajectory.peaks()["joint_speed"], 3),
        "seconds": round(float(times[-1]), 1),
        "slowed": round(export.slowed, 2),
    }

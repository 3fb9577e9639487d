"""Stage `perceived_plans`: the overhand planned from ropes as they are seen, and as they are.

Both plans are executed open loop on the true rope in the planner's simulator, so what differs is
only the shape that was planned from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.perception import (
    Appearance,
    Camera,
    CameraNoiseConfig,
    EstimateConfig,
    SimulatedCamera,
    TraceError,
    estimate,
)
from knotflow.perception.methods import SELF_SUPERVISED
from knotflow.planning import KnotPlan, PlannerConfig, UnreachableGoalError, parse_goal, plan_knot
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import (
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    random_curve,
    state_or_none,
)
from knotflow.topology import DegenerateCurveError
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.perception_networks import load_networks

TABLE = "plans.csv"
KNOT = "overhand"


@dataclass(kw_only=True)
class PerceivedPlansConfig:
    """Which ropes are seen, and how is planned."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that is planned in, and in which plans are executed."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """The random curves in which ropes lie."""
    noise: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    """Of the camera."""
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    """How a rope is estimated."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """Proposes splines."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """How the tree grows, and when a search gives up."""
    ropes: int
    """Random ropes."""
    seed: int
    """Of ropes, light, noise and searches; used for nothing else."""


@stage("perceived_plans")
def plan_what_is_seen(
    config: PerceivedPlansConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes plans.csv, a row a rope and shape planned from (true or estimated).

    Inputs: `networks`, and what the sampler needs.
    """
    names = [f"{number:03d}" for number in range(config.ropes)]
    work = partial(_plan_both, config, dict(inputs))
    context.table(TABLE, work, names, "perceived plans")


def _plan_both(
    config: PerceivedPlansConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> pd.DataFrame:
    rope, camera = config.simulation.rope, Camera.overhead()
    rng = np.random.default_rng([config.seed, int(name)])
    truth = random_curve(rope, rng, config.starts)
    eye = SimulatedCamera(camera, rope, config.noise, Appearance.draw(rng, config.noise))
    network = load_networks(inputs["networks"]).get(SELF_SUPERVISED)
    try:
        found = estimate(
            eye.capture(truth, rng), camera, rope, config=config.estimate, network=network
        )
    except TraceError:
        found = None
    seen = None if found is None else found.points
    rows = [
        {"rope": name, "planned_from": planned_from} | _outcome(config, inputs, points, truth, name)
        for planned_from, points in (("true", truth), ("estimated", seen))
    ]
    return pd.DataFrame(rows)


def _outcome(
    config: PerceivedPlansConfig,
    inputs: Mapping[str, Path],
    points: NDArray | None,
    truth: NDArray,
    name: str,
) -> dict[str, Any]:
    """What came of a plan from a shape (V, 3), metres, executed on the true one; a shape that was
    not found, or from which no actions lead to the knot, has none."""
    row: dict[str, Any] = {"planned": 0, "tied": 0, "branches": 0, "seconds": 0.0}
    if points is None:
        return row | {"mean_error_mm": np.nan}
    error = 1e3 * np.linalg.norm(points - truth, axis=1).mean()
    row["mean_error_mm"] = round(float(error), 3)
    simulator = RopeSimulator(config.simulation)
    rng = np.random.default_rng([config.seed, int(name), 1])
    try:
        plan = plan_knot(
            points,
            parse_goal(KNOT, config.simulation.rope),
            build_sampler(config.sampler, inputs),
            simulator,
            rng,
            config.planner,
        )
    except (UnreachableGoalError, DegenerateCurveError):
        return row
    row |= {"branches": plan.branches, "seconds": round(plan.seconds, 3)}
    tied = plan.solved and _ties(plan, truth, simulator)
    return row | {"planned": int(plan.solved), "tied": int(tied)}


def _ties(plan: KnotPlan, truth: NDArray, simulator: RopeSimulator) -> bool:
    """Whether a plan's splines, one after the other, tie the knot into a rope (V, 3)."""
    rope = truth
    for step in plan.steps:
        rollouts = simulator.execute(rope[None], step.spline[None])
        if rollouts.diverged[0]:
            return False
        rope = rollouts.end_points[0]
    return state_or_none(rope) in plan.goal_states

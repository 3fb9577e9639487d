"""A plan is followed by an arm, and checked by its forward kinematics."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from knotflow.execution import export_plan, panda
from knotflow.planning import KnotPlan, PlannerConfig, parse_goal, plan_knot
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeConfig, RopeSimulator, SimulationConfig, straight
from knotflow.workflow import StageContext
from knotflow.workflow.stages.arm import ArmConfig, check, follow_plans

SIMULATION = SimulationConfig(threads=1)


@pytest.mark.slow
def test_a_row_a_plan(tmp_path: Path):
    config = ArmConfig(
        simulation=SIMULATION,
        sampler=SamplerConfig("aimed"),
        planner=PlannerConfig(batch=8, max_branches=64),
        knot="R1(0,1,1)",
        plans=2,
        seed=3,
    )
    follow_plans(config, {}, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "trajectories.csv")
    assert table["plan"].tolist() == [0, 1] and table["solved"].all()
    assert (table["tip_speed"] <= 0.2501).all() and (table["tip_error_mm"] <= 1.0).all()
    assert (table["limit_margin_deg"] >= 0).all()


@pytest.mark.slow
def test_an_error_is_found_by_forward_kinematics():
    plan: KnotPlan = plan_knot(
        straight(RopeConfig()),
        parse_goal("R1(0,1,1)", RopeConfig()),
        build_sampler(SamplerConfig("aimed"), {}),
        RopeSimulator(SIMULATION),
        np.random.default_rng(1),
        PlannerConfig(batch=8, max_branches=64),
    )
    arm = panda()
    export = export_plan(plan, arm)
    right = check(arm, export)
    assert right["unreached"] == 0 and right["tip_error_mm"] <= 1.0
    export.trajectory.ik.joints[5:] += 0.05  # what the file says is no longer what it claims
    wrong = check(arm, export)
    assert wrong["tip_error_mm"] > 1.0 and wrong["tip_speed"] > right["tip_speed"]

"""The overhand is planned from a rope as it is seen and as it is, and both plans are executed."""

import pandas as pd
import pytest

from knotflow.planning import PlannerConfig
from knotflow.samplers.sampler import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.workflow import StageContext
from knotflow.workflow.stages.perceived_plans import (
    TABLE,
    PerceivedPlansConfig,
    plan_what_is_seen,
)

pytestmark = pytest.mark.slow


def test_a_plan_of_the_true_rope_ties_it_and_one_of_the_estimate_is_held_against_it(tmp_path):
    config = PerceivedPlansConfig(
        simulation=SimulationConfig(threads=1),
        sampler=SamplerConfig("aimed"),
        planner=PlannerConfig(max_branches=64),
        ropes=1,
        seed=3,
    )
    (tmp_path / "networks").mkdir()
    plan_what_is_seen(config, {"networks": tmp_path / "networks"}, StageContext(tmp_path))
    plans = pd.read_csv(tmp_path / TABLE).set_index("planned_from")
    assert list(plans.index) == ["true", "estimated"]
    true, estimated = plans.loc["true"], plans.loc["estimated"]
    assert true["mean_error_mm"] == 0 and 0 < estimated["mean_error_mm"]
    assert true["tied"] == true["planned"]  # simulation repeats itself
    assert (plans["tied"] <= plans["planned"]).all() and (plans["branches"] > 0).all()

"""Plans are executed in every kind of world, and rope sizes reach the simulator."""

from dataclasses import replace

import pandas as pd
import pytest

from knotflow.experiments.robustness import DISTURBANCES, LabRope, by_method, lab_ropes, robustness
from knotflow.planning import PlannerConfig, SurvivalConfig
from knotflow.samplers import SamplerConfig
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES
from knotflow.simulation import SimulationConfig, StartsConfig
from knotflow.workflow import StageRun

PLANNED = {
    "primitives": SHIPPED_PRIMITIVES,
    "simulation": SimulationConfig(threads=2),
    "starts": StartsConfig(),
    "sampler": SamplerConfig("primitives"),
    "planner": PlannerConfig(batch=4, max_branches=60),
    "survival": SurvivalConfig(worlds=0),
    "seed": 3,
}
LOOP = "R1(0,1,1)"


@pytest.mark.slow
def test_a_rope_has_a_row_for_each_disturbance(tmp_path):
    robustness(StageRun(tmp_path), **PLANNED, knot=LOOP, seeds=1, worlds=2)
    table = pd.read_csv(tmp_path / "robustness.csv")
    assert [*table["disturbance"]] == [*DISTURBANCES]
    assert (table["tied"] <= table["worlds"]).all()
    exact = table[table["disturbance"] == "twin_0"]
    assert (exact["tied"] == 2).all()  # without errors, at the planned pace
    again = PLANNED | {"planner": replace(PLANNED["planner"], max_branches=1), "seed": 4}
    hopeless = tmp_path / "hopeless"
    hopeless.mkdir()
    robustness(StageRun(hopeless), **again, knot="overhand", seeds=1, worlds=2)
    assert (pd.read_csv(hopeless / "robustness.csv")["tied"] == 0).all()
    both = tmp_path / "both"
    both.mkdir()
    by_method(StageRun(both), robustness={"shipped": tmp_path, "neither": hopeless})
    counts = pd.read_csv(both / "robustness.csv").groupby("method").size().to_dict()
    assert counts == {"shipped": 6, "neither": 6}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::knotflow.samplers.primitives.UnlikeRopeWarning")
def test_each_rope_is_planned_for_and_executed(tmp_path):
    cases = [LabRope("thick", 1.2, 0.025, 0.06), LabRope("cord", 0.5, 0.004, 0.02)]
    lab_ropes(
        StageRun(tmp_path), **PLANNED, cases=cases, knots=[LOOP], survival_branches=64, seeds=1
    )
    table = pd.read_csv(tmp_path / "ropes.csv")
    assert [*table["rope"]] == ["thick"] * 2 + ["cord"] * 2
    assert [*table["disturbance"]] == ["exact", "level_1"] * 2
    assert table[table["disturbance"] == "exact"]["solved"].all()
    assert (table["length"] == [1.2, 1.2, 0.5, 0.5]).all()

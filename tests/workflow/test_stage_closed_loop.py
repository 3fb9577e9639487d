"""The stages of execution, called by hand on one or two twins and ropes."""

import pandas as pd
import pytest

from knotflow.execution import ExecutionConfig
from knotflow.planning import PlannerConfig
from knotflow.samplers import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.workflow import StageContext
from knotflow.workflow.stages.closed_loop import ClosedLoopConfig, ExecutionCase, execute_plans

pytestmark = pytest.mark.slow

SIMULATION = SimulationConfig(threads=1)


def test_controllers_meet_the_same_twins_and_go_on_where_they_were(tmp_path):
    config = ClosedLoopConfig(
        simulation=SIMULATION,
        sampler=SamplerConfig("aimed"),  # has no undo, so it plans along the DAG alone
        planner=PlannerConfig(batch=8, max_branches=64),
        execution=ExecutionConfig(max_actions=2),
        ensemble=2,
        weights_contents="none",
        cases=[
            ExecutionCase("open_loop", level=1, twins=2, knot="R1(0,1,1)"),
            ExecutionCase("replan_true_state", level=1, twins=1, knot="R1(0,1,1)"),
        ],
        seed=3,
    )
    execute_plans(config, {}, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "executions.csv", keep_default_na=False)
    assert list(zip(table["controller"], table["twin"], strict=True)) == [
        ("open_loop", 0),
        ("replan_true_state", 0),
        ("open_loop", 1),
    ]
    assert table["reported"].tolist()[::2] == ["", ""]
    assert ((table["cause"] == "") == table["tied"]).all()
    first = sorted((tmp_path / "rows").iterdir())
    before = {path: path.stat().st_mtime_ns for path in first}
    execute_plans(config, {}, StageContext(tmp_path))
    assert {path: path.stat().st_mtime_ns for path in first} == before


def test_an_unknown_controller_is_refused():
    with pytest.raises(ValueError, match="'magic'; there are open_loop, "):
        ExecutionCase("magic", level=0, twins=1)

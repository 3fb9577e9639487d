"""The stages of execution, called by hand on one or two twins and ropes."""

import pandas as pd
import pytest

from knotflow.execution import ExecutionConfig
from knotflow.execution.control.dynamics import SHIPPED_DYNAMICS
from knotflow.perception.training_config import SHIPPED_NETWORK
from knotflow.planning import PlannerConfig
from knotflow.recording import read_recording
from knotflow.samplers.sampler import SamplerConfig
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
    assert (table["fault"] == "").all() and not list(tmp_path.glob("film*"))
    first = sorted((tmp_path / "rows").iterdir())
    before = {path: path.stat().st_mtime_ns for path in first}
    execute_plans(config, {}, StageContext(tmp_path))
    assert {path: path.stat().st_mtime_ns for path in first} == before


def test_an_unknown_controller_is_refused():
    with pytest.raises(ValueError, match="'magic'; there are open_loop, "):
        ExecutionCase("magic", level=0, twins=1)
    with pytest.raises(ValueError, match="unknown fault 'rain'; there are "):
        ExecutionCase("open_loop", level=0, twins=1, fault="rain")


def test_one_execution_by_vision_is_shown(tmp_path):
    config = ClosedLoopConfig(
        simulation=SIMULATION,
        sampler=SamplerConfig("aimed"),
        planner=PlannerConfig(batch=8, max_branches=64),
        execution=ExecutionConfig(max_actions=1, max_observations=1),
        ensemble=2,
        weights=str(SHIPPED_DYNAMICS),
        weights_contents="shipped",
        network=str(SHIPPED_NETWORK),
        cases=[ExecutionCase("mppi_replan", level=1, twins=1, knot="R1(0,1,1)")],
        seed=3,
    )
    execute_plans(config, {}, StageContext(tmp_path))
    (row,) = pd.read_csv(tmp_path / "executions.csv", keep_default_na=False).to_dict("records")
    assert row["actions_done"] == 1 and min(row["image_ms"], row["track_ms"], row["mppi_ms"]) > 0
    folder = tmp_path / "film-R1(0,1,1)-1"
    assert sorted(path.suffix for path in folder.iterdir()) == [".gif", ".mcap", ".png", ".svg"]
    assert sum(path.stat().st_size for path in folder.iterdir() if path.suffix == ".mcap") < 1e6
    (drag,) = read_recording(folder / "execution.mcap")
    assert drag.camera.reference.shape == drag.camera.points.shape == drag.points.shape

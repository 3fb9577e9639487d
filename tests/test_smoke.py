"""End to end: the real command, from demonstrations to the report."""

import json
import subprocess
import sys

import pandas as pd
import pytest

from knotflow.recording import load
from knotflow.report.__main__ import main as report
from knotflow.samplers.demonstrations import TASKS
from knotflow.topology import TopologicalState

pytestmark = pytest.mark.slow

ACTIONS = [str(task.action) for task in TASKS]
METHODS = ["random", "icp", "imitation", "reinforcement", "reinforcement_arranged"]


def knotflow(*arguments, module="knotflow"):
    return subprocess.run(
        [sys.executable, "-m", module, *arguments], capture_output=True, text=True, timeout=900
    )


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    asked = ["+experiment=single_stage", "budget=smoke", f"results_dir={folder}"]
    done = knotflow(*asked, "workers.jobs=1")  # other tests run beside it
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_table_has_every_bar(results):
    table = pd.read_csv(results / "single_stage" / "success_rates.csv")
    assert list(table.columns[:3]) == ["method", "action", "training_seed"]
    assert list(zip(table["method"], table["action"], strict=True)) == [
        (method, action) for method in METHODS for action in ACTIONS
    ]
    assert (table["trials"] == 6).all()
    assert (table["successes"] / table["trials"]).round(4).equals(table["success_rate"].round(4))
    assert (table["ci_low"] <= table["success_rate"] + 1e-9).all()
    assert (table["success_rate"] <= table["ci_high"] + 1e-9).all()
    by_method = table.groupby("method")["successes"].sum()
    assert by_method["icp"] > by_method["random"]


def test_every_rollout_is_recorded_with_its_outcome(results):
    table = pd.read_csv(results / "single_stage" / "success_rates.csv")
    record = json.loads((results / "single_stage" / "run.json").read_text())
    for method in METHODS:
        node = record["stages"][f"evaluation[{method}.10]"]
        folder = results / "stages" / node["stage"] / node["key"] / "recordings"
        rollouts = load(folder)
        arranging = rollouts["action"].str.startswith("arrange")
        # One that loses the state it shall keep ends its trial, before the action was tried.
        lost = int((arranging & (rollouts["outcome"] != "success")).sum())
        rollouts = rollouts[~arranging]
        of_method = table[table["method"] == method].set_index("action")
        assert len(rollouts) + lost == of_method["trials"].sum()
        assert rollouts["number"].is_unique
        hits = rollouts[rollouts["outcome"] == "success"].groupby("action").size()
        for action, count in hits.items():
            assert of_method.loc[action, "successes"] == count
    node = record["stages"]["demonstrations"]
    copies = load(results / "stages" / node["stage"] / node["key"] / "recordings")
    assert len(copies) == 48 * 2 + 2 * 8
    assert set(copies["signature"]) == {node["key"]}


def test_exemplars_end_where_their_outcome_says(results):
    rollouts = load(results / "single_stage" / "recordings", trajectories=True)
    assert sorted(rollouts["action"]) == sorted(ACTIONS)
    for row in rollouts.itertuples():
        if row.end_state:
            assert str(TopologicalState.from_curve(row.points[-1])) == row.end_state
        assert (row.outcome == "success") == (row.end_state == row.goal_state)
    for path in (results / "single_stage" / "recordings").glob("*.mcap"):
        assert path.stat().st_size < 1_000_000


def test_a_second_run_makes_nothing_again(results, command):
    before = {path: path.stat().st_mtime_ns for path in (results / "stages").rglob("*.mcap")}
    again = command("+experiment=single_stage", "budget=smoke", results=results)
    assert again.returncode == 0, again.stderr
    assert {
        path: path.stat().st_mtime_ns for path in (results / "stages").rglob("*.mcap")
    } == before


def test_the_report_shows_what_was_measured(results, tmp_path):
    one, two = (["--results", str(results), "--out", str(tmp_path / out)] for out in ("one", "two"))
    assert report(one) == 0
    done = knotflow(*two, module="knotflow.report")  # which hashes otherwise
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "one" / "report.md").read_text()
    assert "smoke" in text and "C(2,0,1)" in text
    for path in sorted((tmp_path / "one").rglob("*")):
        if path.is_file():
            assert (
                path.read_bytes()
                == (tmp_path / "two" / path.relative_to(tmp_path / "one")).read_bytes()
            )

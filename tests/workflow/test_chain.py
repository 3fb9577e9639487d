"""Experiments one after the other."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from knotflow.workflow import CodeState, Experiment, ForeignResultsError, Workflow, run_all

CODE = CodeState("abc", False)


@pytest.fixture
def chained(mapping: dict[str, Any], tmp_path: Path) -> list[Experiment]:
    """Two that share the counting; the second adds something else."""
    other = copy.deepcopy(mapping)
    other["stages"]["adding"]["config"]["offset"] = 7.0
    return [
        Experiment(name, Workflow.from_config(one), tmp_path)
        for name, one in (("first", mapping), ("second", other))
    ]


def test_stages_are_shared_and_all_tell_of_one_commit(chained, calls, tmp_path, capsys):
    folders = run_all(chained, code=CODE, budget="smoke", metrics="none")
    assert folders == [tmp_path / "first", tmp_path / "second"]
    assert calls == ["toy_count", "toy_sum", "toy_sum"]
    for folder in folders:
        record = json.loads((folder / "run.json").read_text())
        assert record["budget"] == "smoke"
        assert {node["commit"] for node in record["stages"].values()} == {"abc"}
    told = capsys.readouterr().out
    assert "[1 of 2] first" in told and "[2 of 2] second" in told
    rows = [line.split() for line in told.splitlines()[-3:]]
    assert [row[:2] for row in rows] == [["first", "2"], ["second", "1"], ["together", "3"]]


def test_one_alone_is_no_chain(chained, capsys):
    run_all(chained[:1], code=CODE, metrics="none")
    assert "of 1" not in capsys.readouterr().out


def test_the_first_failure_ends_it_and_a_rerun_goes_on(chained, calls, between, tmp_path, capsys):
    broken = [*chained[:1], Experiment("second", failing(chained[1]), tmp_path), chained[1]]

    def fail() -> None:
        if "toy_sum" in calls:  # the first experiment is through
            raise RuntimeError("no more of this")

    between(fail)
    with pytest.raises(RuntimeError, match="no more of this") as caught:
        run_all(broken, code=CODE, metrics="none")
    assert caught.value.__notes__[-1] == "Experiment 'second' [2 of 3] is not finished."
    assert (tmp_path / "first" / "run.json").exists() and not (tmp_path / "second").exists()
    assert "second " not in capsys.readouterr().out.rpartition("experiment  ")[2]
    before = (tmp_path / "first" / "run.json").read_bytes()
    between(lambda: None)
    calls.clear()
    run_all(broken[:2], code=CODE, metrics="none")
    assert calls == ["toy_count", "toy_sum"]
    assert (tmp_path / "first" / "run.json").read_bytes() == before


def failing(experiment: Experiment) -> Workflow:
    """The experiment's workflow with another count, which is not made yet."""
    stages = dict(experiment.workflow.stages)
    other = {**stages["toy_count"].config, "shards": 5}
    stages["toy_count"] = type(stages["toy_count"])("toy_count", config=other)
    return Workflow("toy", "", stages, experiment.workflow.results)


def test_foreign_results_of_a_later_one_are_refused_before_anything_runs(chained, calls, tmp_path):
    first, second = chained
    run_all([second], code=CODE, metrics="none")
    calls.clear()
    other = Experiment("second", failing(second), tmp_path)
    with pytest.raises(ForeignResultsError, match="overwrite=true"):
        run_all([first, other], code=CODE, metrics="none")
    assert calls == [] and not (tmp_path / "first").exists()
    replacing = Experiment("second", failing(second), tmp_path, overwrite=True)
    run_all([first, replacing], code=CODE, metrics="none")
    assert calls == ["toy_sum", "toy_count", "toy_sum"]

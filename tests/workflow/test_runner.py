"""A run does each stage once, shares stages between workflows, and says what it does."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Any

import pytest

from knotflow.workflow import CodeState, DamagedStageError, Stage, Workflow, WorkflowError, run

Go = Callable[..., Path]


def records(results: Path) -> dict[str, dict[str, Any]]:
    """Every stage.json, by stage (one signature each)."""
    return {path.parent.parent.name: json.loads(path.read_text()) for path in records_of(results)}


def records_of(results: Path) -> list[Path]:
    """Paths of every stage.json."""
    return sorted(results.glob("stages/*/*/stage.json"))


def test_runs_in_order_and_publishes(go: Go, mapping: dict[str, Any], calls: list[str]) -> None:
    folder = go(mapping)
    assert calls == ["toy_count", "toy_sum"]
    assert (folder / "sum.csv").read_text() == "sum\n9.5\n"  # 3 * (0 + 1 + 2) + 0.5
    assert (folder / "figures" / "toy" / "sum.txt").read_text() == "9\n"
    assert sorted(path.name for path in folder.iterdir()) == [
        "config.yaml",
        "figures",
        "run.json",
        "sum.csv",
    ]


def test_records_tell_where_results_come_from(go: Go, mapping: dict[str, Any]) -> None:
    folder = go(mapping)
    stages = records(folder.parent)
    assert stages["toy_sum"]["inputs"] == {"counts": stages["toy_count"]["signature"]}
    assert stages["toy_count"]["config"] == {"shards": 3, "machine": {"scale": 3}}
    assert stages["toy_count"]["runtime"] == {"machine.threads": 1, "device": "cpu"}
    assert stages["toy_count"]["files"].keys() == {f"shard-{i}.txt" for i in range(3)}
    assert stages["toy_count"]["commit"] == "abc"
    assert stages["toy_count"]["versions"].keys() >= {"python", "numpy"}
    told = json.loads((folder / "run.json").read_text())
    assert told["budget"] == "smoke"
    assert told["stages"]["adding"]["signature"] == stages["toy_sum"]["signature"]
    assert told["stages"]["adding"]["caption"] == "the sum"
    assert told["stages"]["adding"]["origin"] == "run now"
    assert told["results"] == mapping["results"]
    for node, stage in (("toy_count", "toy_count"), ("adding", "toy_sum")):
        for key in ("seconds", "memory_mb", "commit", "dirty", "versions"):
            assert told["stages"][node][key] == stages[stage][key]
    assert not told.keys() & {"commit", "dirty", "versions"}  # of a run there is no one commit


def test_a_raised_package_version_makes_it_again(
    go: Go, mapping: dict[str, Any], calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    used = {"simulation": 1}
    monkeypatch.setattr(Stage, "packages", property(lambda stage: dict(used)))
    folder = go(mapping)
    told = json.loads((folder / "run.json").read_text())["stages"]
    assert [node["packages"] for node in told.values()] == [used, used]
    go(mapping)
    assert calls == ["toy_count", "toy_sum"]
    used["simulation"] = 2
    go(mapping)
    assert calls == ["toy_count", "toy_sum"] * 2


def test_a_finished_stage_keeps_the_commit_that_made_it(go: Go, mapping: dict[str, Any]) -> None:
    go(mapping)
    mapping["stages"]["adding"]["config"]["offset"] = 1.0
    later = CodeState("def", True, "2026-11-22T07:29:04+00:00")
    folder = go(mapping, code=later, overwrite=True)
    told = json.loads((folder / "run.json").read_text())["stages"]
    keys = ("commit", "dirty", "commit_date")
    made = {name: tuple(node[key] for key in keys) for name, node in told.items()}
    assert made == {"toy_count": ("abc", False, None), "adding": astuple(later)}


def test_a_stage_that_is_resumed_keeps_the_commits_of_all_attempts(
    go: Go, mapping: dict[str, Any], between: Callable[..., None]
) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    def attempt(commit: str, dirty: bool, finished: int) -> None:
        """One that is interrupted in the shard after so many."""
        left = iter(range(finished))
        between(lambda: next(left, None) is None and stop())
        with pytest.raises(KeyboardInterrupt):
            go(mapping, code=CodeState(commit, dirty))

    attempt("nothing of it is left", True, 0)
    attempt("abc", True, 1)
    attempt("def", False, 1)
    attempt("abc", False, 0)
    between(lambda: None)
    folder = go(mapping, code=CodeState("def", False))
    told = json.loads((folder / "run.json").read_text())["stages"]
    count, adding = told["toy_count"], told["adding"]
    assert (count["commits"], count["commit"], count["dirty"]) == (["abc", "def"], "def", True)
    assert "commits" not in adding and (adding["commit"], adding["dirty"]) == ("def", False)


def test_never_twice(go: Go, mapping: dict[str, Any], calls: list[str]) -> None:
    first = go(mapping)
    before = {path: path.read_bytes() for path in first.rglob("*") if path.is_file()}
    mapping["stages"]["toy_count"]["config"]["device"] = "cuda"  # cannot change the result
    go(mapping, code=CodeState("def", True))  # what made it is still what it was
    assert calls == ["toy_count", "toy_sum"]
    after = {path: path.read_bytes() for path in first.rglob("*") if path.is_file()}
    assert after == before  # not a byte


def test_workflows_share_stages(go: Go, mapping: dict[str, Any], calls: list[str]) -> None:
    go(mapping)
    mapping |= {"name": "other", "caption": ""}
    mapping["stages"]["adding"]["config"]["offset"] = 1.0
    folder = go(mapping, experiment="other")
    assert calls == ["toy_count", "toy_sum", "toy_sum"]
    told = json.loads((folder / "run.json").read_text())["stages"]
    assert [told[name]["origin"] for name in ("toy_count", "adding")] == ["shared", "run now"]


def test_a_change_upstream_runs_all_below(
    go: Go, mapping: dict[str, Any], calls: list[str]
) -> None:
    go(mapping)
    mapping["stages"]["toy_count"]["config"]["shards"] = 4
    folder = go(mapping, overwrite=True)
    assert calls == ["toy_count", "toy_sum"] * 2
    assert (folder / "sum.csv").read_text() == "sum\n18.5\n"


def test_an_interrupted_stage_goes_on(
    go: Go, mapping: dict[str, Any], calls: list[str], between: Callable[..., None], tmp_path: Path
) -> None:
    seen: list[int] = []

    def interrupt_second() -> None:
        seen.append(len(seen))
        if len(seen) == 2:
            raise KeyboardInterrupt

    between(interrupt_second)
    with pytest.raises(KeyboardInterrupt) as caught:
        go(mapping)
    (partial,) = tmp_path.glob("results/stages/toy_count/*.partial")
    assert str(partial) in caught.value.__notes__[0]
    assert not (tmp_path / "results" / "toy").exists()
    kept = (partial / "shard-0.txt").stat()
    go(mapping)
    assert len(seen) == 4  # shard 0, half of shard 1; then shards 1 and 2
    assert calls == ["toy_count", "toy_count", "toy_sum"]
    again = (partial.with_suffix("") / "shard-0.txt").stat()
    assert (again.st_ino, again.st_mtime_ns) == (kept.st_ino, kept.st_mtime_ns)


def test_what_stopped_a_stage_midway_can_be_traced(
    go: Go, mapping: dict[str, Any], between: Callable[..., None], tmp_path: Path
) -> None:
    seen: list[int] = []

    def fail_second() -> None:
        seen.append(len(seen))
        if len(seen) == 2:
            raise ValueError("no rope")

    between(fail_second)
    with pytest.raises(ValueError, match="no rope") as caught:
        go(mapping)
    (kept,) = tmp_path.glob("results/stages/toy_count/*.partial/traceback.txt")
    assert str(kept) in caught.value.__notes__[1]
    assert "in fail_second" in kept.read_text("utf-8")
    go(mapping)
    assert not list(tmp_path.glob("results/stages/**/traceback.txt"))


def test_a_resumed_stage_finds_no_rests(
    go: Go, mapping: dict[str, Any], between: Callable[..., None], tmp_path: Path
) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    between(stop)
    with pytest.raises(KeyboardInterrupt):
        go(mapping)
    (partial,) = tmp_path.glob("results/stages/toy_count/*.partial")
    (partial / ".tmp-1-large").write_text("what a kill leaves, and a full disk can ill afford")
    seen: set[str] = set()
    between(lambda: seen.update(path.name for path in partial.iterdir()))
    go(mapping)
    assert "shard-0.txt" in seen
    assert ".tmp-1-large" not in seen


def test_plan_and_summary(
    go: Go, mapping: dict[str, Any], between: Callable[..., None], capsys: Any
) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    between(stop)
    with pytest.raises(KeyboardInterrupt):
        go(mapping)
    capsys.readouterr()
    between(lambda: None)
    folder = go(mapping)
    resumed = capsys.readouterr().out.splitlines()
    assert resumed[0] == "toy: counts and their sum"
    assert resumed[1].split()[:2] == ["resume", "toy_count"]
    assert resumed[2].split()[:2] == ["run", "adding"]
    assert f"toy: finished, results in {folder}" in resumed
    assert resumed[-1].split()[0] == "adding"
    assert resumed[-1].endswith("run now")
    go(mapping)
    shared = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in shared[1:3]] == ["done", "done"]
    assert shared[-1].endswith("shared")


def test_a_stage_that_refuses_its_input_leaves_nothing_and_promises_nothing(
    go: Go, mapping: dict[str, Any], between: Callable[..., None], tmp_path: Path
) -> None:
    def refuse() -> None:
        raise ValueError("no such rope")

    between(refuse)
    with pytest.raises(ValueError, match="no such rope") as caught:
        go(mapping)
    assert not getattr(caught.value, "__notes__", ())
    assert not list(tmp_path.glob("results/stages/toy_count/*.partial"))


def test_damage_is_refused_before_any_work(
    go: Go, mapping: dict[str, Any], calls: list[str], tmp_path: Path
) -> None:
    go(mapping)
    (output,) = tmp_path.glob("results/stages/toy_sum/*/sum.csv")
    output.unlink()
    mapping["stages"]["toy_count"]["config"]["device"] = "cuda"
    calls.clear()
    with pytest.raises(DamagedStageError, match=r"sum\.csv \(missing\)"):
        go(mapping)
    assert calls == []


def test_a_result_that_was_not_made(go: Go, mapping: dict[str, Any], tmp_path: Path) -> None:
    mapping["results"]["x.csv"] = "toy_count/x.csv"
    with pytest.raises(WorkflowError, match=r"want \['x.csv'\] of node 'toy_count', which made"):
        go(mapping)
    assert not list(tmp_path.glob("results/stages/toy_sum/*"))  # found out before more was done


def test_bad_settings_cost_no_work(go: Go, mapping: dict[str, Any], calls: list[str]) -> None:
    with pytest.raises(ValueError, match="unknown metrics"):
        go(mapping, metrics="x")
    for experiment in ("stages", "metrics", "../x", "", ".x"):
        with pytest.raises(WorkflowError, match="experiment"):
            go(mapping, experiment=experiment)
    assert calls == []


def test_two_runs_at_once_make_a_stage_once(
    mapping: dict[str, Any], calls: list[str], between: Callable[..., None], tmp_path: Path
) -> None:
    # The lock is held per open file, so two threads meet it as two processes do.
    both = threading.Barrier(2, timeout=30)
    planned = threading.local()

    def start(experiment: str) -> None:
        both.wait()
        planned.folder = run(
            Workflow.from_config(mapping),
            experiment=experiment,
            results_dir=tmp_path / "results",
            code=CodeState("abc"),
            metrics="none",
        )

    threads = [threading.Thread(target=start, args=(name,)) for name in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(calls) == ["toy_count", "toy_sum"]
    tables = [(tmp_path / "results" / name / "sum.csv").read_text() for name in ("one", "two")]
    assert tables == ["sum\n9.5\n"] * 2


def test_metrics_lie_outside_of_outputs(
    go: Go, mapping: dict[str, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from knotflow.workflow import StageContext

    original = StageContext.pending

    def logging_pending(context: StageContext, *arguments: Any) -> list[str]:
        context.logger.log_scalar("shards", 3.0, 0)
        return original(context, *arguments)

    monkeypatch.setattr(StageContext, "pending", logging_pending)
    go(mapping, metrics="csv")
    (curve,) = (tmp_path / "results" / "metrics").rglob("shards.csv")
    assert curve.read_text() == "0,3.0\n"
    assert "shards.csv" not in str(records(tmp_path / "results")["toy_count"]["files"])

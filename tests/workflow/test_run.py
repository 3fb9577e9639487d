import json
import multiprocessing
import shutil
from importlib import metadata
from pathlib import Path

import pytest
import yaml

from knotflow.workflow import DamagedStageError, WorkflowError, run_workflow
from knotflow.workflow.run import code_state, publish

from .conftest import calls


def test_results_and_their_records(go):
    folder = go(budget="smoke")
    assert (folder / "sum.txt").read_text() == "7.5"
    record = json.loads((folder / "run.json").read_text())
    assert record["budget"] == "smoke" and record["results"] == {"sum.txt": "toy_sum/sum.txt"}
    made = record["stages"]["toy_sum"]
    assert made["inputs"] == {"toy_numbers": record["stages"]["toy_numbers"]["key"]}
    assert {"key", "code", "components", "libraries", "seconds", "commit", "dirty"} <= made.keys()
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert config["stages"]["toy_numbers"]["config"] == {
        "shards": 3,
        "toy": {"offset": 0.5},
        "seed": 1,
        "recorded": False,
    }


def test_a_finished_stage_is_never_run_again(go):
    go()
    calls.clear()
    folder = go()
    before = (folder / "run.json").read_bytes()
    assert not calls
    assert (go() / "run.json").read_bytes() == before


def test_only_what_changed_is_made_again(go, root):
    go()
    calls.clear()
    root["workflow"]["stages"]["more"] = {"stage": "toy_sum"}
    go()
    assert not calls
    root["toy_numbers"]["seed"] = 2
    go()
    assert calls == ["0", "1", "2"]


def test_what_a_finished_stage_was_made_from_is_not_made_again(go, root, tmp_path):
    record = json.loads((go() / "run.json").read_text())["stages"]["toy_numbers"]
    shutil.rmtree(tmp_path / "results" / "stages" / "toy_numbers")
    calls.clear()
    kept = json.loads((go() / "run.json").read_text())["stages"]["toy_numbers"]
    assert not calls
    assert kept["key"] == record["key"] and kept["inputs"] == record["inputs"]
    assert "commit" in record and "commit" not in kept
    root["workflow"]["results"]["numbers"] = "toy_numbers/."
    assert (go() / "numbers").is_dir()
    assert calls == ["0", "1", "2"]


def test_an_interrupted_stage_resumes_after_its_last_shard(go, monkeypatch, tmp_path):
    write, left = Path.write_text, [2]

    def failing(self, *args, **more):
        if self.name.endswith(".txt"):
            if not left[0]:
                raise KeyboardInterrupt
            left[0] -= 1
        return write(self, *args, **more)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt) as error:
        patch.setattr(Path, "write_text", failing)
        go()
    assert "the same command goes on" in error.value.__notes__[0]
    assert not (tmp_path / "results" / "toys").exists()
    calls.clear()
    folder = go()
    assert calls == ["2"]
    assert (folder / "sum.txt").read_text() == "7.5"


def test_a_stage_that_made_nothing_leaves_nothing(go, root, tmp_path):
    root["workflow"]["stages"]["toy_sum"]["extra"] = "toy_numbers"  # a folder, not a number
    with pytest.raises(IsADirectoryError):
        go()
    assert not [*(tmp_path / "results" / "stages" / "toy_sum").glob("*.partial")]


def test_results_of_an_earlier_workflow_are_removed(go, root):
    root["workflow"]["results"]["numbers"] = "toy_numbers/."
    assert (go() / "numbers").is_dir()
    del root["workflow"]["results"]["numbers"]
    assert not (go() / "numbers").exists()


def test_a_missing_result_is_named(go, root):
    root["workflow"]["results"]["nothing.csv"] = "toy_sum"
    with pytest.raises(WorkflowError, match="nothing.csv of node 'toy_sum'"):
        go()


def test_a_damaged_output_is_refused(go, tmp_path):
    go()
    (file,) = (tmp_path / "results" / "stages" / "toy_sum").glob("*/sum.txt")
    file.write_text("tampered")
    with pytest.raises(DamagedStageError, match=r"sum\.txt.*delete the folder"):
        go()


def test_recordings_of_a_finished_stage_may_be_deleted(go, root, tmp_path):
    root["toy_numbers"]["recorded"] = True
    go()
    (made,) = (tmp_path / "results" / "stages" / "toy_numbers").glob("*/stage.json")
    recording = made.parent / "recordings" / "0.mcap"
    assert "recordings/0.mcap" in json.loads(made.read_text())["files"]
    recording.unlink()
    calls.clear()
    go()
    assert not calls
    recording.write_text("another")
    with pytest.raises(DamagedStageError, match=r"0\.mcap"):
        go()


def test_shipped_outputs_are_recorded_by_digest_and_not_copied(go, root):
    root["workflow"]["ships"] = {"data/sum.txt": "toy_sum/sum.txt"}
    folder = go()
    (shipped,) = json.loads((folder / "run.json").read_text())["ships"].values()
    assert shipped["node"] == "toy_sum" and len(shipped["digest"]) == 16
    assert not (folder / "data").exists()


def _publish_often(workflow, results, folders, records):
    for _ in range(20):
        run_workflow(workflow, results)


@pytest.mark.slow
def test_runs_of_one_experiment_side_by_side_do_not_disturb_each_other(go, read, tmp_path):
    go()
    context = multiprocessing.get_context("fork")
    arguments = (read(), tmp_path / "results", None, None)
    processes = [context.Process(target=_publish_often, args=arguments) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0, 0]
    assert (tmp_path / "results" / "toys" / "sum.txt").read_text() == "7.5"
    assert publish is not None


def test_what_another_process_makes_is_left_to_it(go, read, root, tmp_path, monkeypatch, capsys):
    stages = root["workflow"]["stages"]
    stages["more"] = {"stage": "toy_numbers", "seed": 2}
    stages["of_more"] = {"stage": "toy_sum", "toy_numbers": "more"}
    root["workflow"]["results"]["more.txt"] = "of_more/sum.txt"
    folders = {name: read().folder(name, tmp_path / "results") for name in read().nodes}
    their = folders["toy_numbers"].lock()
    assert their.__enter__()

    def end_theirs(seconds):
        done = [name for name, folder in folders.items() if folder.final.is_dir()]
        assert done == ["more", "of_more"]  # all that needs not wait
        their.__exit__(None, None, None)

    monkeypatch.setattr("knotflow.workflow.run.time.sleep", end_theirs)
    folder = go()
    assert [(folder / name).read_text() for name in ("sum.txt", "more.txt")] == ["7.5", "10.5"]
    assert capsys.readouterr().out.count("waiting for another process: it makes") == 1


def test_a_checkout_that_is_not_installed_has_no_version(monkeypatch):
    def version(name):
        if name == "knotflow":
            raise metadata.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(metadata, "version", version)
    versions = code_state(Path(__file__).parent)["versions"]
    assert "knotflow" not in versions and versions["torch"] == "1.0"


def test_code_state_of_a_folder_outside_a_checkout(tmp_path):
    state = code_state(tmp_path)
    assert state["commit"] == "none" and not state["dirty"]
    assert {"python", "mujoco", "torch"} <= state["versions"].keys()


@pytest.mark.parametrize("name", ["stages", "../elsewhere", "a/b", ".."])
def test_results_go_into_a_folder_of_their_own(go, name, tmp_path):
    with pytest.raises(WorkflowError, match="results_name="):
        go(name=name)
    assert not list(tmp_path.rglob("run.json"))


def test_results_of_another_workflow_are_not_replaced(go):
    folder = go()
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(run | {"workflow": "other"}))
    with pytest.raises(WorkflowError, match="has results of other"):
        go()
    assert (folder / "sum.txt").is_file()

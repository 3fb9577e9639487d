"""The command: what it says when asked for something it does not have."""

import json
import re
import subprocess
import sys

import pytest
import yaml

from knotflow.__main__ import HOME, PACKAGE
from knotflow.workflow import code_state


def knotflow(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "knotflow", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=cwd,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            [],
            "choose one with +experiment=NAME; experiments are: ablation_actor_critic, actions, ",
        ),
        (
            ["+experiment=single"],
            "no experiment 'single'; experiments are: ablation_actor_critic, actions, arm, ",
        ),
        (["+experiment=benchmark", "budget=huge"], "paper"),
        (["+experiment=benchmark", "simulation.rope.lenght=2"], "lenght"),
        (["+experiment=benchmark", "simulation.timestep=fast"], "timestep"),
        (["+experiment=paper", "knot=pentagram"], "the experiment paper takes nothing of that"),
    ],
)
def test_errors_name_what_is_wrong_and_what_is_valid(arguments, message, tmp_path):
    done = knotflow(*arguments, f"results_dir={tmp_path}", cwd=tmp_path)
    assert done.returncode != 0
    assert message in done.stderr
    assert not list(tmp_path.rglob("*.csv"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["+experiment=overhand", "sampler=icp"], "without it there are aimed, primitives, random"),
        (["+experiment=single_stage", "demonstrations.file=nowhere.jsonl"], "nowhere.jsonl"),
        (["+experiment=benchmark", "metrics=paper"], "csv+tensorboard"),
        (["+experiment=benchmark", "workers.backend=dask"], "there are loky, ray"),
        (["+experiment=paper", "experiments=[benchmark,single]"], "single"),
    ],
)
def test_what_only_the_stages_know_to_be_wrong_is_named_as_well(
    command, arguments, message, tmp_path
):
    refused = command(*arguments, results=tmp_path)
    assert refused.returncode != 0
    assert message in refused.stderr
    assert not list(tmp_path.rglob("*.csv"))


def test_a_package_that_is_missing_is_named_without_a_traceback(monkeypatch, command, tmp_path):
    monkeypatch.setattr("knotflow.workflow.metrics.importlib.util.find_spec", lambda name: None)
    refused = command("+experiment=benchmark", "metrics=mlflow", results=tmp_path)
    assert "'mlflow' need the package mlflow, which is not installed" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_version_is_ours(tmp_path):
    done = knotflow("--version", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(r"knotflow (\d+\.\d+\.\d+|unknown)\n", done.stdout)


@pytest.mark.slow
def test_it_runs_from_any_folder_and_writes_where_it_is_told(tmp_path):
    done = knotflow(
        "+experiment=dynamics",
        *("dynamics.ropes=3", "dynamics.per_rope=1"),
        f"results_dir={tmp_path / 'mine'}",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine" / "dynamics" / "errors.csv").is_file()
    assert {path.name for path in tmp_path.iterdir()} <= {"mine", "MUJOCO_LOG.TXT"}


def test_the_paper_is_all_experiments():
    folder = HOME / "conf" / "experiment"
    chained = yaml.safe_load((folder / "paper.yaml").read_text("utf-8"))["experiments"]
    assert sorted([*chained, "paper"]) == sorted(path.stem for path in folder.glob("*.yaml"))


@pytest.mark.slow
def test_several_experiments_run_with_the_same_overrides_and_go_on(command, tmp_path):
    asked = [
        *("+experiment=paper", "experiments=[dynamics,demonstrator]", "budget=smoke"),
        *("dynamics.per_rope=1", "demonstrator.starts_per_task=0", "demonstrator.guesses=16"),
        *("demonstrator.iterations=1", "demonstrator.least_share=0", "workers.jobs=1"),
    ]
    done = command(*asked, results=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    told = [line.split()[:2] for line in done.stdout.splitlines()[-3:]]
    assert told == [["dynamics", "2"], ["demonstrator", "1"], ["together", "3"]]
    records = {name: tmp_path / name / "run.json" for name in ("dynamics", "demonstrator")}
    runs = [json.loads(path.read_text()) for path in records.values()]
    commits = {node["commit"] for run in runs for node in run["stages"].values()}
    assert commits == {code_state(PACKAGE).commit}
    assert [run["budget"] for run in runs] == ["smoke", "smoke"]
    config = yaml.safe_load((tmp_path / "demonstrator" / "config.yaml").read_text())
    assert config["stages"]["demonstrator"]["config"]["demonstrator"]["guesses"] == 16
    assert {path.name for path in tmp_path.iterdir()} == {*records, "stages"}
    before = {name: path.read_bytes() for name, path in records.items()}
    again = command(*asked, results=tmp_path)
    assert again.returncode == 0, again.stderr
    assert {name: path.read_bytes() for name, path in records.items()} == before

"""The command: what it says when asked for something it does not have."""

import subprocess
import sys

import pytest


def knotflow(*arguments, cwd=None):
    return subprocess.run(
        [sys.executable, "-m", "knotflow", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=cwd,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            [],
            "choose one with +experiment=NAME; experiments are: ablation_actor_critic, benchmark, ",
        ),
        (
            ["+experiment=single"],
            "no experiment 'single'; experiments are: ablation_actor_critic, benchmark, ",
        ),
        (["+experiment=benchmark", "budget=huge"], "paper"),
        (["+experiment=benchmark", "simulation.rope.lenght=2"], "lenght"),
        (["+experiment=benchmark", "simulation.timestep=fast"], "timestep"),
        (["+experiment=benchmark", "metrics=paper"], "csv+tensorboard"),
        (["+experiment=single_stage", "demonstrations.file=nowhere.jsonl"], "nowhere.jsonl"),
    ],
)
def test_errors_name_what_is_wrong_and_what_is_valid(arguments, message, tmp_path):
    done = knotflow(*arguments, f"results_dir={tmp_path}", cwd=tmp_path)
    assert done.returncode != 0
    assert message in done.stderr
    assert not list(tmp_path.rglob("*.csv"))


def test_it_runs_from_any_folder_and_writes_where_it_is_told(tmp_path):
    done = knotflow(
        "+experiment=benchmark",
        "benchmark.rollouts=2",
        f"results_dir={tmp_path / 'mine'}",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine" / "benchmark" / "throughput.csv").is_file()
    assert {path.name for path in tmp_path.iterdir()} <= {"mine", "MUJOCO_LOG.TXT"}

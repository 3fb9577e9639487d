"""The command of experiments: Hydra, and what it says when asked for something it has not."""

from types import SimpleNamespace

import pytest
from hydra.types import RunMode

from knotflow.__main__ import main


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "choose one with +experiment=NAME; there are ablation_actor_critic, actions, arm"),
        (["+experiment=single"], "ablation_actor_critic"),
        (["+experiment=benchmark", "budget=huge"], "paper"),
        (["+experiment=benchmark", "rope.lenght=2"], "lenght"),
        (["+experiment=benchmark", "simulation.timestep=fast"], "timestep"),
        (["+experiment=benchmark", "workers.backend=dask"], "loky or ray"),
        (["+experiment=single_stage", "demonstrations_file=nowhere.jsonl"], "nowhere.jsonl"),
        (["+experiment=knots", "sampler.name=magic"], "magic"),
        (
            ["+experiment=overhand", "+overhand.knto=figure_eight"],
            "'knto'; those of 'overhand' take knot",
        ),
    ],
)
def test_errors_name_what_is_wrong_and_what_is_valid(command, arguments, message, tmp_path):
    done = command(*arguments, results=tmp_path)
    assert done.returncode != 0
    assert message in done.stderr
    assert not list(tmp_path.rglob("*.csv"))


@pytest.mark.slow
def test_an_experiment_runs_and_its_stages_are_kept(command, tmp_path):
    overrides = ("+experiment=benchmark", "budget=smoke", "benchmark.rollouts=4")
    assert command(*overrides, results=tmp_path).returncode == 0
    assert (tmp_path / "benchmark" / "throughput.csv").is_file()
    again = command(*overrides, results=tmp_path)
    assert again.returncode == 0
    assert len(list((tmp_path / "stages" / "throughput").glob("*/stage.json"))) == 1


def test_configuration_is_shown_without_running(command, tmp_path):
    shown = command("--cfg", "job", "+experiment=knots", "planner=paper", results=tmp_path)
    assert "rule: paper" in shown.stdout
    assert not list(tmp_path.rglob("*"))


@pytest.mark.parametrize(("mode", "ends"), [(RunMode.RUN, SystemExit), (RunMode.MULTIRUN, OSError)])
def test_a_job_that_fails_ends_a_run_but_not_a_sweep(monkeypatch, capsys, mode, ends):
    def run_experiment(*_):
        raise OSError("the disk is full")

    monkeypatch.setattr("knotflow.experiments.run.run_experiment", run_experiment)
    sweep = SimpleNamespace(mode=mode, overrides=SimpleNamespace(task=[]))
    monkeypatch.setattr("knotflow.__main__.HydraConfig.get", lambda: sweep)
    with pytest.raises(ends, match="the disk is full"):
        main.__wrapped__(SimpleNamespace(workflow={"name": "knots"}))
    assert (mode is RunMode.MULTIRUN) == ("error: the disk is full" in capsys.readouterr().err)

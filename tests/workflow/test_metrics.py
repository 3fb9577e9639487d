"""Metrics reach the loggers that were asked for."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from knotflow.workflow.metrics import DEFAULT_METRICS, check_metrics, flatten, open_metrics


def write(kind: str, folder: Path) -> None:
    """One run: hyper-parameters and two points."""
    metrics = open_metrics(kind, folder, "train/abc")
    metrics.log_hparams({"rate": 0.1, "network": {"layers": [1, 2], "name": None}})
    metrics.log_scalar("loss", 2.0, 0)
    metrics.log_scalar("loss", 1.0, 10)
    metrics.close()


def test_default_is_csv_and_tensorboard(tmp_path: Path) -> None:
    write(DEFAULT_METRICS, tmp_path)
    curve = tmp_path / "csv" / "train" / "abc" / "scalars" / "loss.csv"
    assert curve.read_text() == "0,2.0\n10,1.0\n"
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path / "tensorboard" / "train" / "abc")).Reload()
    assert [(point.step, point.value) for point in events.Scalars("loss")] == [(0, 2.0), (10, 1.0)]


def test_a_resumed_run_appends(tmp_path: Path) -> None:
    write("csv", tmp_path)
    write("csv", tmp_path)
    curve = tmp_path / "csv" / "train" / "abc" / "scalars" / "loss.csv"
    assert len(curve.read_text().splitlines()) == 4


def test_none_writes_nothing(tmp_path: Path) -> None:
    write("none", tmp_path)
    assert not list(tmp_path.iterdir())


def test_unknown_kind_lists_the_valid_ones(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"unknown metrics 'excel'.*csv.*mlflow, wandb, none"):
        open_metrics("excel", tmp_path, "x")


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for kind in ("mlflow", "wandb"):
        with pytest.raises(ValueError, match=rf"pip install 'knotflow\[{kind}\]'"):
            check_metrics(kind)
    check_metrics("csv")


@pytest.mark.skipif(importlib.util.find_spec("mlflow") is None, reason="mlflow is optional")
def test_mlflow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    write("mlflow", tmp_path / "metrics")
    write("mlflow", tmp_path / "metrics")  # a second run must be able to start
    import mlflow

    experiment = mlflow.get_experiment_by_name("train/abc")
    assert len(mlflow.search_runs([experiment.experiment_id])) == 2


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("wandb") is None, reason="wandb is optional")
def test_wandb_needs_no_account(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("WANDB_MODE", "WANDB_API_KEY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    write("wandb", tmp_path / "metrics")
    write("wandb", tmp_path / "metrics")  # a second run must be able to start
    runs = list((tmp_path / "metrics" / "wandb").glob("offline-run-*/*.wandb"))
    assert len(runs) == 2 and all(run.stat().st_size for run in runs)


def test_hyper_parameters_are_flat_scalars() -> None:
    assert flatten({"a": {"b": [1], "c": True}, "d": 2}) == {"a.b": "[1]", "a.c": True, "d": 2}

"""The committed results folder: of one configuration, complete when it has a run.json."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from knotflow.workflow import ForeignResultsError, publish

Go = Callable[..., Path]


def test_config_has_every_value(go: Go, mapping: dict[str, Any]) -> None:
    config = yaml.safe_load((go(mapping) / "config.yaml").read_text())
    assert config["workflow"] == "toy"
    assert list(config["stages"]) == ["toy_count", "adding"]
    assert config["stages"]["adding"] == {
        "stage": "toy_sum",
        "needs": {"counts": "toy_count"},
        "config": {"offset": 0.5, "factors": [1, 2]},
        "runtime": {},
    }
    assert config["stages"]["toy_count"]["runtime"] == {"machine.threads": 1, "device": "cpu"}


def test_another_configuration_is_refused_before_any_work(
    go: Go, mapping: dict[str, Any], calls: list[str]
) -> None:
    folder = go(mapping)
    before = (folder / "sum.csv").read_text()
    calls.clear()
    mapping["stages"]["toy_count"]["config"]["machine"]["scale"] = 7
    with pytest.raises(ForeignResultsError) as caught:
        go(mapping)
    message = str(caught.value)
    assert "stages.toy_count.config.machine.scale: 3 there, 7 now" in message
    assert "offset" not in message
    assert "results_dir=..." in message and "overwrite=true" in message
    assert calls == []
    assert (folder / "sum.csv").read_text() == before


def test_another_workflow_is_refused(go: Go, mapping: dict[str, Any]) -> None:
    go(mapping)
    del mapping["stages"]["adding"], mapping["results"]
    with pytest.raises(ForeignResultsError, match=r"adding\.stage: 'toy_sum' there, 'nothing' now"):
        go(mapping)


def test_ways_out(go: Go, mapping: dict[str, Any], tmp_path: Path) -> None:
    go(mapping)
    mapping["stages"]["adding"]["config"]["offset"] = 1.5
    assert (go(mapping, results_dir=tmp_path / "r2") / "sum.csv").read_text() == "sum\n10.5\n"
    assert (go(mapping, overwrite=True) / "sum.csv").read_text() == "sum\n10.5\n"
    assert (go(mapping) / "sum.csv").read_text() == "sum\n10.5\n"


def test_threads_and_captions_are_no_other_configuration(go: Go, mapping: dict[str, Any]) -> None:
    go(mapping)
    mapping["caption"] = "other words"
    mapping["stages"]["toy_count"]["config"]["machine"]["threads"] = 16
    config = yaml.safe_load((go(mapping) / "config.yaml").read_text())
    assert config["stages"]["toy_count"]["runtime"]["machine.threads"] == 1  # it was made with


def test_unreadable_config_is_refused(go: Go, mapping: dict[str, Any]) -> None:
    (go(mapping) / "config.yaml").write_text("[1, 2")
    with pytest.raises(ForeignResultsError, match=r"config\.yaml cannot be read"):
        go(mapping)


def test_results_that_are_no_more_are_removed(go: Go, mapping: dict[str, Any]) -> None:
    folder = go(mapping)
    (folder / "notes.md").write_text("written by hand")
    del mapping["results"]["figures/toy"]
    go(mapping)
    assert not (folder / "figures" / "toy").exists()
    assert (folder / "notes.md").exists()


def test_no_run_record_while_results_change(
    go: Go, mapping: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = go(mapping)
    copy = publish._copy
    seen: list[bool] = []

    def watched(source: Path, target: Path) -> None:
        seen.append((folder / "run.json").exists())
        copy(source, target)

    monkeypatch.setattr(publish, "_copy", watched)
    go(mapping)
    assert seen == [False, False]
    assert (folder / "run.json").exists()

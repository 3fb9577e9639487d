"""The committed results folder: which experiments were run, with what, and their tables.

Only `results/<experiment>/` is read; the bulky artifacts in `results/stages/` never are, so the
report can be made from a fresh clone.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from knotflow.report.records import (
    Rates,
    Searches,
    StartRate,
    Throughput,
    read_rates,
    read_searches,
    read_start_rates,
    read_throughput,
)
from knotflow.report.rows import ResultsError, Row, read_rows

#: Folders of results/ that are no experiment: bulky stage outputs and training curves.
NO_EXPERIMENT = ("stages", "metrics")

#: What lies beside the tables and is none: a plan for a robot.
NO_TABLE = ("waypoints.csv",)


@dataclass(frozen=True)
class Stage:
    """One stage of a run, as run.json tells it; `shared` ones were already there when it began."""

    node: str
    stage: str
    signature: str
    seconds: float | None
    shared: bool
    caption: str


@dataclass(frozen=True)
class Experiment:
    """One folder of results/."""

    folder: Path
    run: dict[str, Any]
    config: dict[str, Any]
    tables: dict[str, list[Row]]

    @property
    def name(self) -> str:
        """The folder's name, which is the experiment's."""
        return self.folder.name

    @property
    def budget(self) -> str:
        """`paper` for the paper's counts, `smoke` for the short run of the same chain."""
        return self._wide("budget")

    @property
    def commit(self) -> str:
        """The commit that the run was made with, '' where nothing says."""
        return self._wide("commit")

    @property
    def dirty(self) -> bool:
        """Whether the run was made with changes that the commit does not have."""
        return bool(self.run.get("dirty", False))

    @property
    def measured(self) -> bool:
        """Whether there is any table to show."""
        return bool(self.tables)

    @cached_property
    def stages(self) -> list[Stage]:
        """The run's stages in the order of run.json, which is the order of execution."""
        found = []
        for node, told in _mapping(self.run.get("stages"), self.folder / "run.json").items():
            told = _mapping(told, self.folder / "run.json")
            seconds = told.get("seconds")
            found.append(
                Stage(
                    node=node,
                    stage=str(told.get("stage", node)),
                    signature=str(told.get("signature", "")),
                    seconds=None if seconds is None else float(seconds),
                    shared=bool(told.get("shared")) or told.get("origin") == "shared",
                    caption=str(told.get("caption") or ""),
                )
            )
        return found

    @cached_property
    def ropes(self) -> list[dict[str, Any]]:
        """The ropes that the resolved configuration speaks of, each once."""
        found: list[dict[str, Any]] = []
        pending: list[Any] = [self.config]
        while pending:
            part = pending.pop()
            if not isinstance(part, dict):
                continue
            if {"length", "radius", "links"} <= part.keys() and part not in found:
                found.append(part)
            pending.extend(part.values())
        return found

    @property
    def recordings(self) -> list[Path]:
        """The exemplar recordings committed beside the tables."""
        return sorted(self.folder.rglob("*.mcap"))

    def _wide(self, column: str) -> str:
        for rows in self.tables.values():
            return rows[0].cells[column]
        return str(self.run.get(column) or "")


class Results:
    """Everything the report is made from.

    Raises:
        ResultsError: on loading, where a file is not what its contract says.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        folders = sorted(root.iterdir()) if root.is_dir() else []
        self.experiments = {
            folder.name: _experiment(folder)
            for folder in folders
            if folder.is_dir() and folder.name not in NO_EXPERIMENT and folder.name[0] not in "._"
        }

    def table(self, experiment: str, name: str) -> list[Row] | None:
        """The rows of results/<experiment>/<name>, None where it has not been run."""
        found = self.experiments.get(experiment)
        return found.tables.get(name) if found else None

    def rates(self, experiment: str) -> Rates | None:
        """success_rates.csv of single_stage or ablation_actor_critic."""
        rows = self.table(experiment, "success_rates.csv")
        return read_rates(rows) if rows else None

    def start_rates(self, experiment: str) -> list[StartRate]:
        """per_start.csv beside success_rates.csv, empty where it is not there."""
        rows, rates = self.table(experiment, "per_start.csv"), self.rates(experiment)
        return read_start_rates(rows, rates) if rows and rates else []

    @property
    def tree_size(self) -> Searches | None:
        """tree_size/branches.csv."""
        rows = self.table("tree_size", "branches.csv")
        return read_searches(rows, "method", with_start=True) if rows else None

    @property
    def joint_finetuning(self) -> Searches | None:
        """joint_finetuning/branches.csv."""
        rows = self.table("joint_finetuning", "branches.csv")
        return read_searches(rows, "primitives", with_start=False) if rows else None

    @property
    def throughput(self) -> list[Throughput] | None:
        """benchmark/throughput.csv."""
        rows = self.table("benchmark", "throughput.csv")
        return read_throughput(rows) if rows else None


def _experiment(folder: Path) -> Experiment:
    paths = [path for path in sorted(folder.glob("*.csv")) if path.name not in NO_TABLE]
    tables = {path.name: read_rows(path) for path in paths}
    run_file, config_file = folder / "run.json", folder / "config.yaml"
    try:
        run = json.loads(run_file.read_text("utf-8")) if run_file.is_file() else {}
    except ValueError as problem:
        raise ResultsError(f"{run_file}: not JSON ({problem})") from None
    try:
        config = yaml.safe_load(config_file.read_text("utf-8")) if config_file.is_file() else {}
    except (ValueError, yaml.YAMLError) as problem:
        raise ResultsError(f"{config_file}: not YAML ({problem})") from None
    found = Experiment(folder, _mapping(run, run_file), _mapping(config, config_file), tables)
    told = found.run.get("budget")
    for rows in tables.values():
        if told and rows[0].cells["budget"] != told:
            raise rows[0].error(
                "budget", f"{rows[0].cells['budget']!r}, but run.json beside it says {told!r}"
            )
    return found


def _mapping(value: Any, path: Path) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ResultsError(f"{path}: {type(value).__name__} where a mapping was expected")
    return value

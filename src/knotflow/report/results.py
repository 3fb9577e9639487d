"""The committed results: which experiments were run, with what, and their tables.

Only `results/<experiment>/` is read, never the stage outputs in `results/stages/`, so the report
can be made from a fresh clone.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from knotflow.versions import COMPONENTS

NO_EXPERIMENT = ("stages", "metrics")
"""Folders of results/ with stage outputs and training curves."""
NO_TABLE = "waypoints.csv"
"""A plan for a robot, beside the tables."""
TRUTH = {"true": True, "1": True, "false": False, "0": False}
KINDS = {bool: "true or false", int: "a whole number from 0", float: "a number"}


class ResultsError(ValueError):
    """A file under results/ is not what the report expects; the message names file and line."""


def read_table(
    path: Path,
    columns: Mapping[str, type] | None = None,
    key: Sequence[str] = (),
    *,
    may_be_empty: bool = False,
) -> pd.DataFrame:
    """A CSV with one header line, its `columns` converted, others as text.

    `columns` must be there, of type `str`, `bool`, `int` (not negative) or `float` (an empty cell
    is NaN), and no two rows may share the values of `key`.

    Raises:
        ResultsError: not a table, no rows, a column missing, a cell that is not of its column's
            type, or a repeated row.
    """
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
    except (UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as problem:
        raise ResultsError(f"{path}: not a table ({str(problem).strip()})") from None
    table.attrs["path"] = str(path)
    columns = columns or {}
    if missing := [name for name in columns if name not in table]:
        raise ResultsError(f"{path}: no column {missing[0]}; it has {', '.join(table.columns)}")
    if table.empty and not may_be_empty:
        raise ResultsError(f"{path}: a header and no rows")
    for name, kind in columns.items():
        if kind is not str:
            table[name] = _convert(table, name, kind)
    if key:
        names = ", ".join(f"{{{name}}}" for name in key)
        refuse(table, table.duplicated(list(key)), f"{names} is there twice")
    return table


def _convert(table: pd.DataFrame, name: str, kind: type) -> pd.Series:
    cells = table[name].str.strip()
    if kind is bool:
        values = cells.str.lower().map(TRUTH)
        wrong = values.isna()
    else:
        values = pd.to_numeric(cells, errors="coerce").astype(float)
        wrong = ~np.isfinite(values) & ~((cells == "") & (kind is float))
        if kind is int:
            wrong |= (values < 0) | (values % 1 != 0)
    refuse(table, wrong, f"{name} is '{{{name}}}' and should be {KINDS[kind]}")
    return values.astype(kind)


def refuse(table: pd.DataFrame, wrong: pd.Series, problem: str) -> None:
    """Raise ResultsError for the first row that is `wrong`; `problem` may name its `{columns}`."""
    if wrong.any():
        row = int(wrong.to_numpy().argmax())
        message = problem.format(**table.iloc[row].to_dict())
        raise ResultsError(f"{table.attrs['path']}, line {row + 2}: {message}")


class NotMeasured(Exception):
    """There is no table of what is asked for; the message says what is missing."""


class Experiment:
    """One folder of results/."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run = _read(folder / "run.json", json.loads)
        self.config = _read(folder / "config.yaml", yaml.safe_load)
        self.stages: dict[str, dict[str, Any]] = self.run.get("stages") or {}
        """What run.json says of each node, in the order of execution."""
        self.budget = str(self.run.get("budget") or "unknown")
        """`paper` for the paper's counts, `smoke` for the short run of the same chain."""

    @cached_property
    def tables(self) -> list[Path]:
        """Its CSVs, by name; without any it was not run."""
        return [path for path in sorted(self.folder.glob("*.csv")) if path.name != NO_TABLE]

    @property
    def commits(self) -> str:
        """The commits that its stages were made with."""
        stages = self.stages.values()
        found = dict.fromkeys(made["commit"][:10] for made in stages if made.get("commit"))
        words = ", ".join(f"`{commit}`" for commit in found) or "unknown"
        dirty = any(made.get("dirty") for made in stages)
        return f"{words} with uncommitted changes" if dirty else words

    @property
    def stale(self) -> str:
        """Why today's code would make these results otherwise, as far as run.json says; else ''."""
        oldest: dict[str, int] = {}
        for made in self.stages.values():
            for name, version in (made.get("components") or made.get("packages") or {}).items():
                oldest[name] = min(version, oldest.get(name, version))
        reasons = [
            f"{name} {version}, now {COMPONENTS[name].version}"
            for name, version in sorted(oldest.items())
            if name in COMPONENTS and version < COMPONENTS[name].version
        ]
        if any(not made.get("key") for made in self.stages.values()):
            reasons.append("made before stages had keys")
        return "; ".join(reasons)


class Results:
    """Everything the report is made from.

    Raises:
        ResultsError: the folder does not exist, or run.json or config.yaml cannot be read.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        if not root.is_dir():
            raise ResultsError(f"{root}: there is no such results folder")
        self.experiments = {
            folder.name: Experiment(folder)
            for folder in sorted(root.iterdir())
            if folder.is_dir() and folder.name not in NO_EXPERIMENT and folder.name[0] not in "._"
        }

    @cached_property
    def afternoon(self) -> Results | None:
        """Those of budget=afternoon, which are in a folder of their own; None without any."""
        return Results(folder) if (folder := self.root / "afternoon").is_dir() else None

    def measured(self, experiment: str) -> Experiment | None:
        """An experiment, None where it was not run."""
        found = self.experiments.get(experiment)
        return found if found and found.tables else None

    def table(
        self, experiment: str, name: str, columns: Mapping[str, type], key: Sequence[str] = (),
        **options: bool,
    ) -> pd.DataFrame:  # fmt: skip
        """results/<experiment>/<name> by `read_table`.

        Raises:
            NotMeasured: it is not there.
        """
        path = self.root / experiment / name
        if not path.is_file():
            raise NotMeasured(f"needs {name} in {experiment}")
        return read_table(path, columns, key, **options)

    def setting(self, experiment: str, name: str, node: str = "") -> Any:
        """What an experiment's stages, or those with `node` in their name, were configured with.

        The name is looked for at any depth, the outermost first; None where nothing says.
        """
        found = self.experiments.get(experiment)
        stages = (found.config.get("stages") or {}) if found else {}
        for stage in (own for label, own in stages.items() if node in label):
            for value in _values(stage.get("config"), name):
                return value
        return None


def _values(config: Any, name: str) -> Iterator[Any]:
    if isinstance(config, dict):
        if name in config:
            yield config[name]
        for part in config.values():
            yield from _values(part, name)


def _read(path: Path, parse: Callable[[str], Any]) -> dict[str, Any]:
    """A file with a mapping; empty where there is no file."""
    try:
        found = parse(path.read_text("utf-8")) if path.is_file() else {}
    except (ValueError, yaml.YAMLError) as problem:
        raise ResultsError(f"{path}: cannot be read ({problem})") from None
    if not isinstance(found, dict):
        raise ResultsError(f"{path}: {type(found).__name__} where a mapping was expected")
    return found

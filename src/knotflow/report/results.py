"""The committed results folder: which experiments were run, with what, and their tables.

Only `results/<experiment>/` is read; the bulky artifacts in `results/stages/` never are, so the
report can be made from a fresh clone. Every table is read by `read_table`, which holds each cell
against what its column promises.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from knotflow.versions import COMPONENTS

#: Folders of results/ that are no experiment: bulky stage outputs and training curves.
NO_EXPERIMENT = ("stages", "metrics")

#: What lies beside the tables and is none: a plan for a robot.
NO_TABLE = ("waypoints.csv",)

_FLAGS = {"true": True, "1": True, "false": False, "0": False}


class ResultsError(ValueError):
    """A file under results/ is not what its contract says; the message names file, column, row."""


@dataclass(frozen=True)
class Column:
    """What the cells of a column have to be."""

    kind: str
    """`text`, `flag` (true or false in any case, 1 or 0), `number` or `count`."""
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False
    """Whether a cell may be empty; an empty number is read as NaN."""


TEXT, NOTE, FLAG = Column("text"), Column("text", optional=True), Column("flag")
NUMBER, AMOUNT, SHARE = Column("number"), Column("number", 0), Column("number", 0, 1)
COUNT, AT_LEAST_ONE = Column("count", 0), Column("count", 1)


def read_table(
    path: Path, columns: Mapping[str, Column] | None = None, key: Sequence[str] = ()
) -> pd.DataFrame:
    """A CSV with one header line; `columns` are read as what they promise, others as text.

    Its index counts data rows from 1, and `refuse` knows its path.

    Args:
        path: of the CSV.
        columns: those that the table must have.
        key: columns that no two rows may share the values of.

    Raises:
        ResultsError: not a table, a column missing or there twice, no rows, a cell that is not
            what its column promises, or a row that stands there twice.
    """
    try:
        cells = pd.read_csv(
            path,
            header=None,
            dtype=str,
            keep_default_na=False,
            skip_blank_lines=False,
            encoding="utf-8-sig",
        )
    except (UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as problem:
        raise ResultsError(f"{path}: not a table ({str(problem).strip()})") from None
    header = cells.iloc[0].tolist()
    for name in header:
        if header.count(name) > 1:
            raise ResultsError(f"{path}: column {name!r} appears more than once")
    table = cells.iloc[1:].set_axis(header, axis=1)
    table.attrs["path"] = str(path)
    if table.empty:
        raise ResultsError(f"{path}: a header and no rows")
    for name, column in (columns or {}).items():
        if name not in header:
            raise ResultsError(f"{path}: column {name!r} is missing; it has {', '.join(header)}")
        table[name] = _cells(table, name, column)
    if key:
        cells = ", ".join(f"{{{name}}}" for name in key)
        again = table.duplicated(list(key))
        refuse(table, key[-1], again, f"{cells} stands in an earlier row already")
    return table


def refuse(table: pd.DataFrame, column: str, wrong: pd.Series, problem: str) -> None:
    """Raise ResultsError for the first row that is `wrong`; `problem` may name its `{columns}`."""
    if wrong.any():
        row = int(wrong.idxmax())
        message = problem.format(**table.loc[row].to_dict())
        path = table.attrs["path"]
        raise ResultsError(f"{path}, column {column!r}, row {row} (line {row + 1}): {message}")


def _cells(table: pd.DataFrame, name: str, column: Column) -> pd.Series:
    cells, quoted = table[name], f"'{{{name}}}'"
    empty = cells.str.strip() == ""
    if column.kind == "text":
        refuse(table, name, empty & (not column.optional), "is empty")
        return cells
    if column.kind == "flag":
        flags = cells.str.strip().str.lower().map(_FLAGS)
        refuse(table, name, flags.isna(), f"{quoted} is neither true nor false")
        return flags.astype(bool)
    values = pd.to_numeric(cells, errors="coerce")
    absent = empty & column.optional
    refuse(table, name, values.isna() & ~absent, f"{quoted} is not a number")
    inside = values.between(column.low, column.high) & (values.abs() < math.inf)
    limits = f"{quoted} is outside [{column.low:g}, {column.high:g}]"
    refuse(table, name, ~inside & ~absent, limits)
    if column.kind == "number":
        return values
    refuse(table, name, values % 1 != 0, f"{quoted} is not a whole number")
    return values.astype(int)


FIRST_VERSIONS = {
    "demonstrations": 1,
    "planning": 1,
    "primitives": 1,
    "simulation": 1,
    "training": 1,
}
"""Of a stage from before versions were recorded, when these packages had not changed yet."""


@dataclass(frozen=True)
class StageRun:
    """One stage of a run, as run.json reports it; `shared` ones were there when it began."""

    node: str
    stage: str
    signature: str
    seconds: float | None
    shared: bool
    caption: str
    commit: str
    """The commit it was made with, '' where nothing says."""
    commit_date: str
    """When that was committed, in ISO 8601; '' where nobody noted it."""
    dirty: bool
    """Whether it was made with changes that the commit does not have."""
    packages: Mapping[str, int]
    """The versions of the packages whose behaviour it depends on, see `versions`."""
    memory_mb: float | None = None
    """Most that it held at once, its workers included; of early stages nobody noted it."""
    shards: int = 0
    """How many of its shards could run side by side; 0 where it has none, or nobody noted it."""
    cpus: int | None = None
    """Of the machine that made it; None where nobody noted it."""
    commits: tuple[str, ...] = ()  # of all attempts that it was made in


@dataclass(frozen=True)
class ExperimentResults:
    """One folder of results/."""

    folder: Path
    run: dict[str, Any]
    config: dict[str, Any]

    @property
    def name(self) -> str:
        """The folder's name, which is the experiment's."""
        return self.folder.name

    @property
    def budget(self) -> str:
        """`paper` for the paper's counts, `smoke` for the short run of the same chain."""
        return str(self.run.get("budget") or "")

    @property
    def paper(self) -> bool:
        """Whether it has the paper's counts."""
        return self.budget == "paper"

    @cached_property
    def tables(self) -> list[Path]:
        """Its CSVs, by name."""
        return [path for path in sorted(self.folder.glob("*.csv")) if path.name not in NO_TABLE]

    @property
    def measured(self) -> bool:
        """Whether there is any table to show."""
        return bool(self.tables)

    @cached_property
    def stages(self) -> list[StageRun]:
        """The run's stages in the order of run.json, which is the order of execution."""
        found, path = [], self.folder / "run.json"
        for node, entry in _mapping(self.run.get("stages"), path).items():
            made = _mapping(entry, path)
            seconds, memory = made.get("seconds"), made.get("memory_mb")
            found.append(
                StageRun(
                    node=node,
                    stage=str(made.get("stage", node)),
                    signature=str(made.get("signature", "")),
                    seconds=None if seconds is None else float(seconds),
                    shared=bool(made.get("shared")) or made.get("origin") == "shared",
                    caption=str(made.get("caption") or ""),
                    commit=str(made.get("commit") or ""),
                    commit_date=str(made.get("commit_date") or ""),
                    dirty=bool(made.get("dirty")),
                    packages=_mapping(made.get("packages", FIRST_VERSIONS), path),
                    memory_mb=None if memory is None else float(memory),
                    shards=int(made.get("shards") or 0),
                    cpus=made.get("cpus"),
                    commits=tuple(made.get("commits") or [made.get("commit") or ""]),
                )
            )
        return found

    @property
    def commits(self) -> str:
        """The commits that its stages were made with, as a reader needs them.

        The earliest and the latest where every commit's date was noted, else each of them.
        """
        dates = {commit: "" for stage in self.stages for commit in stage.commits if commit}
        dates |= {stage.commit: stage.commit_date for stage in self.stages if stage.commit}
        short = [f"`{commit[:10]}`" for commit in dates]
        if len(short) < 2:
            words = f"commit {short[0]}" if short else "commit unknown"
        elif all(dates.values()):
            first, *_, last = sorted(dates, key=lambda one: datetime.fromisoformat(dates[one]))
            words = f"{len(short)} commits, from `{first[:10]}` to `{last[:10]}`"
        else:
            words = f"{len(short)} commits: {', '.join(short)}"
        unknown = sum(not stage.commit for stage in self.stages)
        if short and unknown:
            words += f", unknown for {unknown} of {len(self.stages)} stages"
        dirty = any(stage.dirty for stage in self.stages)
        return f"{words}, with uncommitted changes" if dirty else words

    @property
    def outdated(self) -> str:
        """The packages that have changed their behaviour since, with both versions; else ''."""
        made: dict[str, int] = {}
        for stage in self.stages:
            for name, version in stage.packages.items():
                made[name] = min(version, made.get(name, version))
        old = [
            f"{name} {version}, now {COMPONENTS[name].version}"
            for name, version in sorted(made.items())
            if name in COMPONENTS and version < COMPONENTS[name].version
        ]
        return "; ".join(old)

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


class Results:
    """Everything the report is made from.

    Raises:
        ResultsError: on loading, where the folder does not exist, run.json or config.yaml cannot
            be read, or a table was cut.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        if not root.is_dir():
            raise ResultsError(f"{root}: there is no such results folder")
        folders = sorted(root.iterdir())
        self.experiments = {
            folder.name: _experiment(folder)
            for folder in folders
            if folder.is_dir() and folder.name not in NO_EXPERIMENT and folder.name[0] not in "._"
        }

    def table(
        self,
        experiment: str,
        name: str,
        columns: Mapping[str, Column] | None = None,
        key: Sequence[str] = (),
    ) -> pd.DataFrame | None:
        """results/<experiment>/<name> by `read_table`, None where it has not been run."""
        path = self.root / experiment / name
        return read_table(path, columns, key) if path.is_file() else None

    def setting(self, experiment: str, node: str, *keys: str) -> Any:
        """What a stage of an experiment was configured with, None where nothing says."""
        found = self.experiments.get(experiment)
        value: Any = found.config if found else None
        for key in ("stages", node, "config", *keys):
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def paper(self, experiment: str) -> bool:
        """Whether an experiment was run with the paper's counts."""
        found = self.experiments.get(experiment)
        return found is not None and found.paper


def _experiment(folder: Path) -> ExperimentResults:
    run_file, config_file = folder / "run.json", folder / "config.yaml"
    try:
        run = json.loads(run_file.read_text("utf-8")) if run_file.is_file() else {}
    except ValueError as problem:
        raise ResultsError(f"{run_file}: not JSON ({problem})") from None
    try:
        config = yaml.safe_load(config_file.read_text("utf-8")) if config_file.is_file() else {}
    except (ValueError, yaml.YAMLError) as problem:
        raise ResultsError(f"{config_file}: not YAML ({problem})") from None
    _check_whole(folder, _mapping(run, run_file))
    return ExperimentResults(folder, _mapping(run, run_file), _mapping(config, config_file))


def _check_whole(folder: Path, run: Mapping[str, Any]) -> None:
    """Refuse a table of another size than run.json says: one that was cut reads like a whole."""
    for name, size in _mapping(run.get("bytes"), folder / "run.json").items():
        path = folder / name
        if path.suffix == ".csv" and path.is_file() and path.stat().st_size != size:
            raise ResultsError(
                f"{path}: has {path.stat().st_size} bytes, but {size} when it was made: it was cut "
                f"or edited; take it from the repository, or run +experiment={folder.name} again"
            )


def _mapping(value: Any, path: Path) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ResultsError(f"{path}: {type(value).__name__} where a mapping was expected")
    return value

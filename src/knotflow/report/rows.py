"""Rows of a results CSV: cells read as the type a column promises, errors that name the place."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

#: Every committed table begins with these columns.
EXPERIMENT_COLUMNS = ("experiment", "budget", "commit")


class ResultsError(ValueError):
    """A file under results/ is not what its contract says; the message names file, column, row."""


@dataclass(frozen=True)
class Row:
    """One row of a CSV; `number` counts data rows from 1, `line` is the line in the file."""

    path: Path
    number: int
    line: int
    cells: dict[str, str]

    def error(self, column: str, problem: str) -> ResultsError:
        """The error that says what is wrong in `column` of this row."""
        return ResultsError(
            f"{self.path}, column {column!r}, row {self.number} (line {self.line}): {problem}"
        )

    def text(self, column: str) -> str:
        """The cell as it stands."""
        return self.cells[column]

    def number_in(self, column: str, low: float, high: float = math.inf) -> float:
        """The cell as a finite number within [low, high]."""
        try:
            value = float(self.cells[column])
        except ValueError:
            raise self.error(column, f"{self.cells[column]!r} is not a number") from None
        if not math.isfinite(value) or not low <= value <= high:
            raise self.error(column, f"{value:g} is outside [{low:g}, {high:g}]")
        return value

    def count(self, column: str, at_least: int = 0) -> int:
        """The cell as a whole number, `at_least` or more."""
        value = self.number_in(column, at_least)
        if value != int(value):
            raise self.error(column, f"{self.cells[column]!r} is not a whole number")
        return int(value)

    def flag(self, column: str) -> bool:
        """The cell as a truth value: true or false in any case, 1 or 0."""
        known = {"true": True, "1": True, "false": False, "0": False}
        cell = self.cells[column].strip().lower()
        if cell not in known:
            raise self.error(column, f"{self.cells[column]!r} is neither true nor false")
        return known[cell]


def read_rows(path: Path) -> list[Row]:
    """All rows of a CSV that begins with the experiment-wide columns.

    Raises:
        ResultsError: not a text file, no header, no rows, a repeated column, a row of another
            length than the header, or an experiment-wide column missing or changing its value.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as problem:
        raise ResultsError(f"{path}: not UTF-8 text ({problem})") from None
    reader = csv.reader(text.splitlines(keepends=True))
    header = next(reader, [])
    if not header:
        raise ResultsError(f"{path}: empty; needs a header line")
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise ResultsError(f"{path}: column {doubled[0]!r} appears more than once")
    rows: list[Row] = []
    for cells in reader:
        number = len(rows) + 1
        if len(cells) != len(header):
            raise ResultsError(
                f"{path}, row {number} (line {reader.line_num}): {len(cells)} cells, "
                f"the header has {len(header)} columns"
            )
        row = Row(path, number, reader.line_num, dict(zip(header, cells, strict=True)))
        rows.append(row)
    if not rows:
        raise ResultsError(f"{path}: a header and no rows")
    require(rows, EXPERIMENT_COLUMNS)
    for row in rows:
        for column in EXPERIMENT_COLUMNS:
            if row.cells[column] != rows[0].cells[column]:
                raise row.error(
                    column,
                    f"{row.cells[column]!r}, but row 1 says {rows[0].cells[column]!r}; "
                    "a table is of one run",
                )
    return rows


def require(rows: list[Row], columns: tuple[str, ...]) -> None:
    """Raise ResultsError naming the first of `columns` that the table lacks."""
    have = rows[0].cells
    for column in columns:
        if column not in have:
            raise ResultsError(
                f"{rows[0].path}: column {column!r} is missing; it has {', '.join(have)}"
            )

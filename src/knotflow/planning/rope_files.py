"""Files of measured centre lines: CSV, NPY, XYZ and Geomview's VECT.

A CSV has a row a point. Commas, semicolons (with decimal commas, too), tabs and blanks separate;
`#` begins a comment. A header row may name the columns: x, y, z and over are then found among
others, and a unit in brackets, such as `x [mm]`, counts.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotflow.arrays import read_npy
from knotflow.topology.polyline import Floats, arc_lengths

MIN_POINTS = 5
"""Least number of points in a file."""
MAX_POINTS = 1001
"""Most points that are kept of a file, evenly along the curve: reading crossings takes memory with
the square."""
SUFFIXES = (".csv", ".npy", ".xyz", ".vect")
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units of a file's numbers, in metres."""

_AXES = ("x", "y", "z")
_NAME = re.compile(r"\s*([a-z]\w*?)[\s_]*(?:[\[(]?\s*(mm|cm|m)\s*[\])]?)?\s*", re.IGNORECASE)


class RopeInputError(ValueError):
    """A rope file that cannot be read as a rope that lies on the table."""


@dataclass(frozen=True, eq=False)
class RopeTable:
    """The rows of a file."""

    points: Floats
    """(N, 3), or (N, 2) where there is no z, metres, head first, without repetitions."""
    unit: str | None
    """Of the file's numbers, as stated in its header or asked for; None takes metres."""
    over: Floats | None = None
    """(N,) column `over`: 1 where the rope is the upper strand of a crossing, else 0."""
    closed: bool = False
    """Whether the file says that the last point is joined to the first."""


def read_table(path: Path, unit: str | None = None) -> RopeTable:
    """The points of a file, at most `MAX_POINTS`.

    `unit` is that of its numbers, one of `METRES`; None takes the header's, else metres.

    Raises:
        RopeInputError: no such file, or not (N, 3) or (N, 2) finite numbers.
    """
    if unit is not None and unit not in METRES:
        raise RopeInputError(f"unknown unit {unit!r} of a rope; there are {', '.join(METRES)}")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RopeInputError(f"{path}: a rope is a file *{' or *'.join(SUFFIXES)}")
    if not path.is_file():
        raise RopeInputError(f"{path}: there is no such rope file")
    over, stated, closed = None, None, False
    try:
        if suffix == ".csv":
            points, over, stated = _read_csv(path)
        elif suffix == ".vect":
            points, closed = _read_vect(path)
        else:
            points = _read_npy(path) if suffix == ".npy" else _read_xyz(path)
    except (OSError, EOFError, csv.Error) as error:
        raise RopeInputError(f"{path}: cannot be read: {error}") from error
    if unit is not None and stated is not None and unit != stated:
        raise RopeInputError(f"{path}: its header says {stated}, but {unit} was asked for")
    unit = unit or stated
    points = points * METRES[unit or "m"]
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise RopeInputError(
            f"{path}: a rope has rows of x, y, z, shape (N, 3), or of x, y; the file has shape "
            f"{points.shape}"
        )
    if len(points) < MIN_POINTS:
        raise RopeInputError(
            f"{path}: {len(points)} points are too few for a rope, at least {MIN_POINTS} are needed"
        )
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        number = int(np.argmin(finite))
        raise RopeInputError(
            f"{path}: point {number} (counted from 0) is {points[number].tolist()}; all numbers "
            "must be finite, so leave out points that were not measured"
        )
    apart = np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0]
    if apart.sum() == 1:
        raise RopeInputError(f"{path}: all points are the same")
    columns = points[apart] if over is None else np.column_stack([points, over])[apart]
    if len(columns) > MAX_POINTS:
        along = arc_lengths(points[apart])
        at = np.linspace(0.0, along[-1], MAX_POINTS)
        columns = np.column_stack([np.interp(at, along, column) for column in columns.T])
    size = points.shape[1]
    return RopeTable(columns[:, :size], unit, None if over is None else columns[:, size], closed)


def _read_npy(path: Path) -> Floats:
    cure = "save the points with numpy.save(path, points), an array (N, 3) of numbers"
    try:
        loaded = read_npy(path)
    except ValueError as error:
        raise RopeInputError(f"{path}: not an array of numbers ({error}); {cure}") from None
    if loaded.dtype.kind not in "iuf":
        raise RopeInputError(f"{path}: holds {loaded.dtype}, not an array of numbers; {cure}")
    return loaded.astype(np.float64)


def _read_xyz(path: Path) -> Floats:
    """Rows of x, y, z, further columns left out; a count, a comment and symbols may precede."""
    rows = [line.split() for line in _read_text(path).splitlines()]
    if rows and len(rows[0]) == 1 and rows[0][0].isdigit():
        rows = rows[2:]
    rows = [row if _is_number(row[0]) else row[1:] for row in rows if row]
    return _numbers(path, [row[:3] for row in rows])


def _read_vect(path: Path) -> tuple[Floats, bool]:
    """The points of a file with one polyline, and whether it is closed."""
    magic, *words = re.sub(r"#.*", "", _read_text(path)).split() or [""]
    counts = _numbers(path, [words[:5]])[0] if len(words) > 4 else np.zeros(5)
    if magic != "VECT" or counts[0] != 1 or not abs(counts[3]) <= len(words):
        raise RopeInputError(
            f"{path}: a rope is a VECT file with one polyline; this one "
            + (f"has {counts[0]:g}" if magic == "VECT" else "does not begin with VECT")
        )
    rows = [words[at : at + 3] for at in range(5, 5 + 3 * int(abs(counts[3])), 3)]
    return _numbers(path, rows), bool(counts[3] < 0)


def _numbers(path: Path, rows: list[list[str]]) -> Floats:
    width = len(rows[0]) if rows else 0
    for number, row in enumerate(rows):
        if len(row) != width or not all(map(_is_number, row)):
            raise RopeInputError(
                f"{path}: point {number} (counted from 0) is {' '.join(row)!r}, not x, y, z"
            )
    return np.array(rows, np.float64).reshape(len(rows), width)


def _read_text(path: Path) -> str:
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise RopeInputError(f"{path}: not UTF-8 text; save it as text in UTF-8") from None


def _read_csv(path: Path) -> tuple[Floats, Floats | None, str | None]:
    """Points, the column `over` if there is one, and the header's unit."""
    lines = {
        number: bare
        for number, line in enumerate(_read_text(path).splitlines(), 1)
        if (bare := line.split("#")[0].strip())
    }
    if not lines:
        raise RopeInputError(f"{path}: holds no points; write x, y, z of a point in a row")
    mark = next((mark for mark in ";,\t" if any(mark in line for line in lines.values())), "")
    decimal = "," if mark == ";" else "."
    rows = {  # each by itself: a stray quotation mark swallows no other line
        number: next(csv.reader([line], delimiter=mark, skipinitialspace=True))
        if mark
        else line.split()
        for number, line in lines.items()
    }
    names, units = _header(rows[next(iter(rows))])
    if names:
        del rows[next(iter(rows))]
    widest = max(map(len, rows.values()), default=0)
    known = sorted(name for name in names if name in _AXES)
    columns = [*known] if known in ([*_AXES], ["x", "y"]) else [*_AXES[: max(widest, 2)]]
    chosen = [names.index(axis) for axis in known] if columns == known else [*range(len(columns))]
    named = columns == known
    if named and names.count("over") == 1:
        columns, chosen = [*columns, "over"], [*chosen, names.index("over")]
    stated = {unit for name, unit in zip(names, units, strict=True) if name in _AXES and unit}
    if len(stated) > 1:
        raise RopeInputError(f"{path}: its header gives different units: {', '.join(stated)}")
    points = []
    for line, cells in rows.items():
        where = f"{path}, line {line}"
        if len(cells) > 3 and not named:
            raise RopeInputError(
                f"{where}: has {len(cells)} values, a point has x, y, z; delete the "
                "others, or say in a header row which columns are x, y and z"
            )
        given = [cells[index].strip() if index < len(cells) else "" for index in chosen]
        for axis, cell in zip(columns, given, strict=True):
            if not cell and axis != "over":
                raise RopeInputError(f"{where}: has no {axis}; complete the row or delete it")
            if cell and not _is_number(cell.replace(decimal, ".")):
                raise RopeInputError(
                    f"{where}: {axis} is {cell!r}, which is no number; only one header row may "
                    "come before the points, and # begins a comment"
                )
        points.append([float(cell.replace(decimal, ".") or 0) for cell in given])
    table = np.array(points).reshape(-1, len(columns))
    over = table[:, -1] if columns[-1] == "over" else None
    return table[:, : len(columns) - (over is not None)], over, next(iter(stated), None)


def _header(cells: list[str]) -> tuple[list[str], list[str]]:
    """Names and units of the columns; none where the first row has a number."""
    if any(_is_number(cell.replace(",", ".")) for cell in cells):
        return [], []
    matches = [_NAME.fullmatch(cell.lower()) for cell in cells]
    return [one[1] if one else "" for one in matches], [
        one[2] or "" if one else "" for one in matches
    ]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

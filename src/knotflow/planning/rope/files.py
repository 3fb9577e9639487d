"""Files of measured centre lines: CSV, NPY, XYZ and Geomview's VECT.

A CSV has a row a point. Commas, semicolons (with decimal commas, too), tabs and blanks separate;
`#` begins a comment. A header row may name the columns: x, y, z and over are then found among
others, and a unit in brackets, such as `x [mm]`, counts.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np

from knotflow.arrays import floats, read_npy
from knotflow.planning.frame import METRES
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

ROPE_NAMES = ("straight", "arc", "random")
"""Ropes that are generated."""
SUFFIXES = (".csv", ".npy", ".xyz", ".vect")
FARTHEST = 1e6
"""Metres from the origin, that a point may be along an axis."""
MIN_POINTS = 5
MAX_POINTS = 1001
"""Most points that are kept, evenly along the curve: reading crossings takes memory with the
square."""

_NAME = r"^([a-z]\w*?)[\s_]*(?:[\[(]?\s*(mm|cm|m)\s*[\])]?)?$"
_OTHER_UNIT = r"[xyz]_(?:in|inch|inches|ft|feet|yd|nm|um|dm|km|px|pixels?)$"
_LONG_UNITS = {r"millimet(?:er|re)s?": "mm", r"centimet(?:er|re)s?": "cm", r"met(?:er|re)s?": "m"}


class RopeInputError(ValueError):
    """A rope file that cannot be read as a rope that lies on the table."""


@dataclass(frozen=True, eq=False)
class RopeTable:
    """A measured centre line: the rows of a file, or an estimate."""

    points: Floats
    """(N, 3), or (N, 2) where there is no z, metres, head first, without repetitions."""
    unit: str | None = None
    """Of the file's numbers, as stated in its header or asked for; None takes metres."""
    over: Floats | None = None
    """(N,) column `over`: 1 where the rope is the upper strand of a crossing, else 0."""
    rows: Floats | None = None
    """(N,) each point's number in the file, from 0, once `checked`."""
    closed: bool = False
    """Whether the file says that the last point is joined to the first."""
    name: str = "the rope"
    """Of its file or image, for errors."""


def read_table(path: Path, unit: str | None = None) -> RopeTable:
    """The points of a file, at most `MAX_POINTS`.

    `unit` is that of its numbers, one of `METRES`; None takes the header's, else metres.

    Raises:
        RopeInputError: no such file, or not (N, 3) or (N, 2) finite numbers.
    """
    if unit is not None and unit not in METRES:
        raise RopeInputError(f"unknown unit {unit!r} of a rope; there are {', '.join(METRES)}")
    readers = dict(zip(SUFFIXES, (_read_csv, _read_npy, _read_xyz, _read_vect), strict=True))
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RopeInputError(
            f"unknown rope {str(path)!r}: give one of {', '.join(ROPE_NAMES)}, or a file "
            f"*{' or *'.join(SUFFIXES)} of points (N, 3)"
        )
    if not path.is_file():
        raise RopeInputError(f"{path}: there is no such rope file")
    try:
        table = reader(path)
    except (OSError, EOFError) as error:
        raise RopeInputError(f"{path}: cannot be read: {error}") from error
    if unit and table.unit and unit != table.unit:
        raise RopeInputError(f"{path}: its header says {table.unit}, but {unit} was asked for")
    unit = unit or table.unit
    name, points = str(path), table.points * METRES[unit or "m"]
    return checked(replace(table, name=name, points=points, unit=unit))


def checked(table: RopeTable) -> RopeTable:
    """The table without repetitions and with at most `MAX_POINTS` points.

    Raises:
        RopeInputError: not (N, 3) or (N, 2) finite numbers of a line.
    """
    name, over = table.name, table.over
    points = floats(table.points, f"{name}: a rope's points", RopeInputError)
    if table.unit is not None and table.unit not in METRES:
        raise RopeInputError(f"{name}: unknown unit {table.unit!r}; there are {', '.join(METRES)}")
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise RopeInputError(
            f"{name}: a rope has rows of x, y, z, shape (N, 3), or of x, y; this one has shape "
            f"{points.shape}"
        )
    if len(points) < MIN_POINTS:
        raise RopeInputError(
            f"{name}: {len(points)} points are too few for a rope, at least {MIN_POINTS} are needed"
        )
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        number = int(np.argmin(finite))
        raise RopeInputError(
            f"{name}: point {number} (counted from 0) is {points[number].tolist()}; all numbers "
            "must be finite, so leave out points that were not measured"
        )
    if (far := float(np.abs(points).max())) > FARTHEST:
        raise RopeInputError(f"{name}: a point is {far:.3g} m from the origin; no rope lies there")
    apart = np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0]
    if apart.sum() == 1:
        raise RopeInputError(f"{name}: all points are the same")
    rows = np.flatnonzero(apart).astype(float)
    points, over = points[apart], None if over is None else over[apart]
    if len(points) > MAX_POINTS:
        along = arc_lengths(points)
        at = np.linspace(0.0, along[-1], MAX_POINTS)
        points = interpolate(at, along, points)
        over = None if over is None else np.interp(at, along, over)
        rows = np.interp(at, along, rows)
    return replace(table, points=points, over=over, rows=rows)


def _read_npy(path: Path) -> RopeTable:
    cure = "save the points with numpy.save(path, points), an array (N, 3) of numbers"
    try:
        loaded = read_npy(path)
    except ValueError as error:
        raise RopeInputError(f"{path}: not an array of numbers ({error}); {cure}") from None
    if loaded.dtype.kind not in "iuf":
        raise RopeInputError(f"{path}: holds {loaded.dtype}, not an array of numbers; {cure}")
    return RopeTable(loaded.astype(np.float64))


def _read_xyz(path: Path) -> RopeTable:
    """Rows of x, y, z, further columns left out; a count, a comment and symbols may precede."""
    rows = [line.split() for line in _read_text(path).splitlines()]
    if rows and len(rows[0]) == 1 and rows[0][0].isdigit():
        rows = rows[2:]
    rows = [row if _is_number(row[0]) else row[1:] for row in rows if row]
    return RopeTable(_numbers(path, [row[:3] for row in rows]))


def _read_vect(path: Path) -> RopeTable:
    """The points of one polyline, whose number is negative where it is closed."""
    magic, *words = re.sub(r"#.*", "", _read_text(path)).split() or [""]
    counts = _numbers(path, [words[:5]])[0] if len(words) > 4 else np.zeros(5)
    if magic != "VECT" or counts[0] != 1 or not abs(counts[3]) <= len(words):
        raise RopeInputError(
            f"{path}: a rope is a VECT file with one polyline; this one "
            + (f"has {counts[0]:g}" if magic == "VECT" else "does not begin with VECT")
        )
    rows = [words[at : at + 3] for at in range(5, 5 + 3 * int(abs(counts[3])), 3)]
    return RopeTable(_numbers(path, rows), closed=bool(counts[3] < 0))


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


def _read_csv(path: Path) -> RopeTable:
    import pandas as pd  # slow to import

    text = re.sub(r"#.*", "", _read_text(path))
    mark = next((mark for mark in ";,\t" if mark in text), None)
    if mark == ";":  # decimal commas
        text = text.replace(",", ".")
    lines = [[cell.strip(' "') for cell in line.split(mark)] for line in text.splitlines()]
    cells = pd.DataFrame([*zip_longest(*lines)], dtype=object).T
    cells.index += 1  # as editors count lines
    cells = cells.mask(cells == "").dropna(how="all").dropna(how="all", axis="columns")
    cells.columns = range(cells.shape[1])
    if cells.empty:
        raise RopeInputError(f"{path}: holds no points; write x, y, z of a point in a row")
    unit, names = None, {}
    first = cells.iloc[0].str.lower()
    if pd.to_numeric(first, errors="coerce").isna().all() and not first.eq("nan").any():
        first = first.replace(_LONG_UNITS, regex=True)
        header = first.str.extract(_NAME)
        unread = header[0].isna() & first.str.match(r"(?:[xyz]|over)(?![a-z])", na=False)
        strange = first[unread | first.str.match(_OTHER_UNIT, na=False)]
        if not strange.empty:
            raise RopeInputError(
                f"{path}: its header has {strange.iloc[0]!r}; write x, y, z and over, with a unit "
                f"perhaps, as in x [mm]; units are {', '.join(METRES)}"
            )
        axes = header[0][header[0].isin([*"xyz", "over"])]
        if axes.duplicated().any():
            raise RopeInputError(
                f"{path}: its header names {axes[axes.duplicated()].iloc[0]} twice; delete the "
                "columns that are not the rope's"
            )
        cells = cells.iloc[1:]
        names = {name: at for at, name in header[0].items()}
        units = header[1][header[0].isin([*"xyz"])].dropna().unique()
        if len(units) > 1:
            raise RopeInputError(f"{path}: its header gives different units: {', '.join(units)}")
        unit = next(iter(units), None)
    if {"x", "y"} <= names.keys():
        columns = {name: names[name] for name in ("x", "y", "z", "over") if name in names}
    elif len(cells.columns) > 3:
        raise RopeInputError(
            f"{path}, line {cells[3].notna().idxmax()}: a point has x, y, z, and here are more "
            "values; delete the others, or say in a header row which columns are x, y and z"
        )
    elif strange := [
        name
        for name, axis in zip(names, "xyz", strict=False)
        if not str(name).startswith(axis) and not str(name).endswith(axis)
    ]:
        raise RopeInputError(
            f"{path}: its header has {strange[0]!r} where x, y and z are expected; name the "
            "columns of the centre line x, y and z"
        )
    else:
        columns = {axis: at for at, axis in enumerate("xyz"[: max(2, len(cells.columns))])}
    cells = pd.DataFrame({axis: cells.get(at) for axis, at in columns.items()}, cells.index)
    if "over" in columns:
        cells["over"] = cells["over"].fillna("0")
    numbers = cells.apply(pd.to_numeric, errors="coerce")
    missing = numbers.isna()
    if missing.any(axis=None):
        line = missing.any(axis="columns").idxmax()
        axis = missing.loc[line].idxmax()
        cell = cells.at[line, axis]
        raise RopeInputError(
            f"{path}, line {line}: has no {axis}; complete the row or delete it"
            if pd.isna(cell)
            else f"{path}, line {line}: {axis} is {cell!r}, which is no number; only one header "
            "row may come before the points, and # begins a comment"
        )
    over = numbers.pop("over").to_numpy(float) if "over" in columns else None
    return RopeTable(numbers.to_numpy(float), unit, over)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

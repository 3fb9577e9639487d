"""The points of a measured rope in a CSV or NPY file.

A CSV has a row a point. Commas, semicolons (with decimal commas, too), tabs and blanks separate;
`#` begins a comment. A header row may name the columns: x, y and z are then found among others, and
a unit in brackets, such as `x [mm]`, counts.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.arrays import read_npy

MIN_VERTICES = 5
"""A curve of fewer points says too little of how the rope bends."""
MAX_VERTICES = 1001
"""Of a curve with more, as many points evenly along it are kept: a millimetre apart on a rope of a
metre, where its crossings are a diameter apart. Reading them takes memory with the square."""

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""What the units of a file are worth."""

Floats = NDArray[np.float64]

_AXES = ("x", "y", "z")
_NAME = re.compile(r"\s*([a-z]\w*?)[\s_]*(?:[\[(]?\s*(mm|cm|m)\s*[\])]?)?\s*", re.IGNORECASE)


class RopeInputError(ValueError):
    """A rope file that cannot be read as a rope that lies on the table."""


def read_points(path: Path, unit: str | None = None) -> Floats:
    """The file's points (N, 3), metres, each apart from the one before, `MAX_VERTICES` at most.

    Args:
        path: of a *.csv or *.npy file.
        unit: of its numbers, one of `METRES`; None takes the header's, else metres.

    Raises:
        RopeInputError: no such file, or not (V, 3) finite numbers; names the line and the cure.
    """
    if unit is not None and unit not in METRES:
        raise RopeInputError(f"unknown unit {unit!r} of a rope; there are {', '.join(METRES)}")
    if path.suffix.lower() not in _READERS:
        raise RopeInputError(f"{path}: a rope is a file *{' or *'.join(SUFFIXES)}")
    if not path.is_file():
        raise RopeInputError(f"{path}: there is no such rope file")
    try:
        points, stated = _READERS[path.suffix.lower()](path)
    except (OSError, EOFError, csv.Error) as error:
        raise RopeInputError(f"{path}: cannot be read: {error}") from error
    if unit is not None and stated is not None and unit != stated:
        raise RopeInputError(f"{path}: its header says {stated}, but {unit} was asked for")
    points = points * METRES[unit or stated or "m"]
    if points.ndim != 2 or points.shape[1] != 3:
        raise RopeInputError(
            f"{path}: a rope has rows of x, y, z, shape (V, 3); the file has shape {points.shape}"
        )
    if len(points) < MIN_VERTICES:
        raise RopeInputError(
            f"{path}: {len(points)} points are too few for a rope, at least {MIN_VERTICES} are "
            "needed"
        )
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        vertex = int(np.argmin(finite))
        raise RopeInputError(
            f"{path}: point {vertex} (counted from 0) is {points[vertex].tolist()}; all numbers "
            "must be finite, so leave out points that were not measured"
        )
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0
    if not apart.any():
        raise RopeInputError(f"{path}: all points are the same")
    return _thinned(points[np.r_[True, apart]])


def _thinned(points: Floats) -> Floats:
    if len(points) <= MAX_VERTICES:
        return points
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.linspace(0.0, along[-1], MAX_VERTICES)
    return np.column_stack([np.interp(at, along, column) for column in points.T])


def _read_npy(path: Path) -> tuple[Floats, None]:
    cure = "save the points with numpy.save(path, points), an array (V, 3) of numbers"
    try:
        loaded = read_npy(path)
    except ValueError as error:
        raise RopeInputError(f"{path}: not an array of numbers ({error}); {cure}") from None
    if loaded.dtype.kind not in "iuf":
        raise RopeInputError(f"{path}: holds {loaded.dtype}, not an array of numbers; {cure}")
    return loaded.astype(np.float64), None


def _read_csv(path: Path) -> tuple[Floats, str | None]:
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise RopeInputError(f"{path}: not UTF-8 text; save it as CSV in UTF-8") from None
    bare = [line.split("#")[0].strip() for line in text.splitlines()]
    decimal, rows = _cells({number: line for number, line in enumerate(bare, 1) if line})
    if not rows:
        raise RopeInputError(f"{path}: holds no points; write x, y, z of a point in a row")
    first = next(iter(rows))
    names = _header(rows[first])
    if names:
        del rows[first]
    found = [index for axis in _AXES for index, (name, _) in enumerate(names) if name == axis]
    named = len(found) == len(_AXES)
    chosen = found if named else [0, 1, 2]
    points = []
    for line, cells in rows.items():
        if len(cells) > 3 and not named:
            raise RopeInputError(
                f"{path}, line {line}: has {len(cells)} values, a point has x, y, z; delete the "
                "others, or say in a header row which columns are x, y and z"
            )
        points.append(_point(f"{path}, line {line}", cells, chosen, decimal))
    units = {unit for index in found if (unit := names[index][1]) is not None}
    if len(units) > 1:
        raise RopeInputError(f"{path}: its header gives different units: {', '.join(units)}")
    return np.array(points).reshape(-1, 3), next(iter(units), None)


def _cells(lines: dict[int, str]) -> tuple[str, dict[int, list[str]]]:
    """The decimal mark, and of each line its cells; what separates them stands in the lines."""
    text = "\n".join(lines.values())
    separator = next((mark for mark in ";,\t" if mark in text), None)
    decimal = "," if separator == ";" else "."
    if separator is None:
        return decimal, {number: line.split() for number, line in lines.items()}
    return decimal, {  # each by itself: a stray quotation mark swallows no other line
        number: next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        for number, line in lines.items()
    }


def _header(cells: list[str]) -> list[tuple[str, str | None]]:
    """Names and units of the columns; none where the first row has a number."""
    if any(_is_number(cell.replace(",", ".")) for cell in cells):
        return []
    matches = [_NAME.fullmatch(cell) for cell in cells]
    return [(one[1].lower(), one[2] and one[2].lower()) if one else ("", None) for one in matches]


def _point(where: str, cells: list[str], chosen: list[int], decimal: str) -> list[float]:
    """The numbers in the chosen columns of a row."""
    given = [cells[index].strip() if index < len(cells) else "" for index in chosen]
    for axis, cell in zip(_AXES, given, strict=True):
        if not cell:
            raise RopeInputError(f"{where}: has no {axis}; complete the row or delete it")
        if not _is_number(cell.replace(decimal, ".")):
            raise RopeInputError(
                f"{where}: {axis} is {cell!r}, which is no number; only one header row may come "
                "before the points, and # begins a comment"
            )
    return [float(cell.replace(decimal, ".")) for cell in given]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


_READERS: dict[str, Callable[[Path], tuple[Floats, str | None]]] = {
    ".csv": _read_csv,
    ".npy": _read_npy,
}
SUFFIXES = tuple(_READERS)

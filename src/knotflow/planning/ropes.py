"""The rope to tie: a generated start, or a measured one from a CSV or NPY file.

A CSV has a row a point. Commas, semicolons (with decimal commas, too), tabs and blanks separate;
`#` begins a comment. A header row may name the columns: x, y and z are then found among others, and
a unit in brackets, such as `x [mm]`, counts.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from knotflow.arrays import read_npy
from knotflow.simulation import (
    SPLINE_HIGH,
    RopeConfig,
    StartsConfig,
    arc,
    random_curve,
    resample,
    straight,
)
from knotflow.topology import DegenerateCurveError, TopologicalState, project
from knotflow.topology.polyline import Floats

MIN_VERTICES = 5
"""Least number of points in a file."""
MAX_VERTICES = 1001
"""Most points that are kept of a file, evenly along the curve: reading crossings takes memory with
the square."""

SUFFIXES = (".csv", ".npy")

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units of a file's numbers, in metres."""

_AXES = ("x", "y", "z")
_NAME = re.compile(r"\s*([a-z]\w*?)[\s_]*(?:[\[(]?\s*(mm|cm|m)\s*[\])]?)?\s*", re.IGNORECASE)

MIN_VISIBLE = 0.5
"""Least share of a rope's length that is seen from above."""
LENGTH_TOLERANCE = 0.05
"""Relative difference of a file's rope length from the model's that counts as measuring error."""

ROPE_NAMES = ("straight", "arc", "random")


class RopeInputError(ValueError):
    """A rope file that cannot be read as a rope that lies on the table."""


def parse_rope(
    text: str,
    rope: RopeConfig,
    rng: np.random.Generator,
    starts: StartsConfig | None = None,
    unit: str | None = None,
) -> Floats:
    """The rope shape (V, 3), metres, that a text names.

    It is "straight", "arc", "random", or the path of a CSV or NPY file, see `read_rope`.

    Raises:
        RopeInputError: neither a valid name nor a usable file.
    """
    if text == "random":
        return random_curve(rope, rng, starts or StartsConfig())
    if text in ROPE_NAMES:
        return straight(rope) if text == "straight" else arc(rope)
    if Path(text).suffix.lower() not in SUFFIXES:
        raise RopeInputError(
            f"unknown rope {text!r}: give one of {', '.join(ROPE_NAMES)}, or a file "
            f"*{' or *'.join(SUFFIXES)} of points (V, 3)"
        )
    return read_rope(Path(text), rope, unit)


def read_rope(path: Path, rope: RopeConfig, unit: str | None = None) -> Floats:
    """A measured rope (V, 3), metres, resampled to the model's links and laid on the table.

    The file has points of the centre line, one a row: x, y, z, z up, head first, any table height.
    At crossings z says which strand is on top.

    Raises:
        RopeInputError: an unreadable file, or a rope that the model cannot be or splines not reach.
    """
    curve = read_points(path, unit)
    steps = np.diff(curve, axis=0)
    length = float(np.linalg.norm(steps, axis=1).sum())
    above = float(np.linalg.norm(steps[:, :2], axis=1).sum())
    if above < MIN_VISIBLE * length:
        raise RopeInputError(
            f"{path}: this rope stands or hangs rather than lies: of its {length:.3g} m, "
            f"{above:.3g} m are seen from above. Columns are x, y, z with z up, and the rope lies "
            "on a table"
        )
    try:
        state = TopologicalState.from_curve(curve)
    except DegenerateCurveError as error:
        raise RopeInputError(
            f"{path}: how this rope crosses itself cannot be read when seen from above: {error}."
            " Measure the strands at the crossing more closely: z must say which one is on top, and"
            " neither an end nor two strands may lie exactly on another in x and y"
        ) from error
    if abs(length / rope.length - 1.0) > LENGTH_TOLERANCE:
        raise RopeInputError(
            f"{path}: the rope is {length:.3g} m long, but the model's is {rope.length:g} m; "
            f"{_length_cure(length, rope)}"
        )
    points = lay_down(curve, rope)
    direction = np.diff(points, axis=0) / rope.link_length
    cosine = np.clip((direction[1:] * direction[:-1]).sum(axis=1), -1.0, 1.0)
    bend = np.arccos(cosine)
    if bend.max() > rope.max_bend:
        vertex = int(bend.argmax()) + 1
        raise RopeInputError(
            f"{path}: at {points[vertex, :2].round(3).tolist()} m the rope bends by "
            f"{np.rad2deg(bend.max()):.0f} degrees from one link of {rope.link_length * 1e3:g} mm "
            f"to the next, the model's rope by {np.rad2deg(rope.max_bend):.0f} at most; smooth the "
            "points, they may be noisy or out of order"
        )
    reach = float(SPLINE_HIGH[-1])
    far = np.abs(points[:, :2]).max(axis=1)
    if far.max() > reach:
        vertex = int(far.argmax())
        raise RopeInputError(
            f"{path}: vertex {vertex} lies at {points[vertex, :2].round(3).tolist()} m, out of the "
            f"splines' reach of {reach:g} m in x and y; put the origin in the middle of the rope"
        )
    if _state_or_text(points) != state:
        raise RopeInputError(
            f"{path}: the file's rope has the state {state}, but laid with links of "
            f"{rope.link_length * 1e3:g} mm it reads as {_state_or_text(points)}: its crossings "
            "are closer together than the model can resolve; take more links or a looser rope"
        )
    return points


def lay_down(curve: Floats, rope: RopeConfig) -> Floats:
    """A curve (N, 3), metres, head first, as the model's rope (V, 3) at rest on the table (z = 0).

    Crossings that already have the heights of a rope at rest, about a diameter apart, keep them;
    else every over strand is lifted. Without crossings it lies flat.
    """
    curve = np.array(curve, np.float64)
    curve[:, 2] += rope.radius - curve[:, 2].min()
    crossings = project(curve)
    heights = {p + 1: height for p, height in enumerate(crossings.heights)}
    gaps = [heights[over] - heights[under] for over, under, _ in crossings.crossings]
    low = 6.0 * rope.radius  # three strands on top of each other
    if not gaps:
        curve[:, 2] = rope.radius
    elif min(gaps) < 1.5 * rope.radius or curve[:, 2].max() > low:
        curve = _lift(resample(curve, rope), rope)
    return resample(curve, rope)


def _lift(points: Floats, rope: RopeConfig) -> Floats:
    """Heights (V, 3) of a rope at rest: a smooth hump of a diameter at every over passage."""
    crossings = project(points)
    over = [p - 1 for p, _, _ in crossings.crossings]
    under = [p - 1 for _, p, _ in crossings.crossings]
    along = np.linspace(0.0, 1.0, len(points))  # links are equal
    height = np.zeros(len(points))
    widest = 4.0 * rope.radius + 2.0 * rope.link_length
    for passage in over:
        middle = crossings.fractions[passage]
        room = np.abs(crossings.fractions[under] - middle).min() * rope.length
        # At least a link to either side, or no vertex need lie on the hump.
        width = max(min(widest, room), 1.2 * rope.link_length)
        u = np.clip(np.abs(along - middle) * rope.length / width, 0.0, 1.0)
        height = np.maximum(height, 1.0 - u**2 * (3.0 - 2.0 * u))
    lifted = points.copy()
    lifted[:, 2] = rope.radius + 2.5 * rope.radius * height
    return lifted


def _length_cure(length: float, rope: RopeConfig) -> str:
    for unit, metres in METRES.items():
        if unit != "m" and abs(length * metres / rope.length - 1.0) <= LENGTH_TOLERANCE:
            return (
                f"its numbers look like {unit}: give --rope-unit {unit}, or name the columns with "
                f"the unit, as in x [{unit}]"
            )
    return f"set the model rope's length to {length:.3g} (points are in metres)"


def _state_or_text(points: Floats) -> TopologicalState | str:
    try:
        return TopologicalState.from_curve(points)
    except DegenerateCurveError as error:
        return f"no state ({error})"


def read_points(path: Path, unit: str | None = None) -> Floats:
    """The file's points (N, 3), metres, without repetitions, `MAX_VERTICES` at most.

    `unit` is that of its numbers, one of `METRES`; None takes the header's, else metres.

    Raises:
        RopeInputError: no such file, or not (V, 3) finite numbers.
    """
    if unit is not None and unit not in METRES:
        raise RopeInputError(f"unknown unit {unit!r} of a rope; there are {', '.join(METRES)}")
    if (suffix := path.suffix.lower()) not in SUFFIXES:
        raise RopeInputError(f"{path}: a rope is a file *{' or *'.join(SUFFIXES)}")
    if not path.is_file():
        raise RopeInputError(f"{path}: there is no such rope file")
    try:
        points, stated = _read_csv(path) if suffix == ".csv" else (_read_npy(path), None)
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
    points = points[np.r_[True, apart]]
    if len(points) <= MAX_VERTICES:
        return points
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.linspace(0.0, along[-1], MAX_VERTICES)
    return np.column_stack([np.interp(at, along, column) for column in points.T])


def _read_npy(path: Path) -> Floats:
    cure = "save the points with numpy.save(path, points), an array (V, 3) of numbers"
    try:
        loaded = read_npy(path)
    except ValueError as error:
        raise RopeInputError(f"{path}: not an array of numbers ({error}); {cure}") from None
    if loaded.dtype.kind not in "iuf":
        raise RopeInputError(f"{path}: holds {loaded.dtype}, not an array of numbers; {cure}")
    return loaded.astype(np.float64)


def _read_csv(path: Path) -> tuple[Floats, str | None]:
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise RopeInputError(f"{path}: not UTF-8 text; save it as CSV in UTF-8") from None
    lines = {
        number: bare
        for number, line in enumerate(text.splitlines(), 1)
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
    named = sorted(name for name in names if name in _AXES) == [*_AXES]
    chosen = [names.index(axis) for axis in _AXES] if named else [0, 1, 2]
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
        for axis, cell in zip(_AXES, given, strict=True):
            if not cell:
                raise RopeInputError(f"{where}: has no {axis}; complete the row or delete it")
            if not _is_number(cell.replace(decimal, ".")):
                raise RopeInputError(
                    f"{where}: {axis} is {cell!r}, which is no number; only one header row may "
                    "come before the points, and # begins a comment"
                )
        points.append([float(cell.replace(decimal, ".")) for cell in given])
    return np.array(points).reshape(-1, 3), next(iter(stated), None)


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

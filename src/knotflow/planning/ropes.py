"""The rope to tie: a generated start, or one that was measured and comes in a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.rope_file import METRES, SUFFIXES, RopeInputError, read_points
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

Floats = NDArray[np.float64]

MIN_VISIBLE = 0.5
"""Of a rope's length, what is to be seen from above: one that lies on a table shows nearly all."""

LENGTH_TOLERANCE = 0.05
"""Relative difference of a file's rope length from the model's that counts as measuring error."""

_GENERATORS: dict[str, Callable[[RopeConfig, np.random.Generator, StartsConfig], Floats]] = {
    "straight": lambda rope, rng, starts: straight(rope),
    "arc": lambda rope, rng, starts: arc(rope),
    "random": random_curve,
}

ROPE_NAMES = tuple(_GENERATORS)


def parse_rope(
    text: str,
    rope: RopeConfig,
    rng: np.random.Generator,
    starts: StartsConfig | None = None,
    unit: str | None = None,
) -> Floats:
    """The rope shape (V, 3), metres, that a text names.

    Args:
        text: "straight", "arc", "random", or the path of a CSV or NPY file, see `read_rope`.
        rope: the model's rope, which gives V.
        rng: draws the random curve.
        starts: how random curves look.
        unit: of a file's numbers, see `read_rope`.

    Raises:
        RopeInputError: neither a valid name nor a usable file.
    """
    if text in _GENERATORS:
        return _GENERATORS[text](rope, rng, starts or StartsConfig())
    if Path(text).suffix.lower() not in SUFFIXES:
        raise RopeInputError(
            f"unknown rope {text!r}: give one of {', '.join(ROPE_NAMES)}, or a file "
            f"*{' or *'.join(SUFFIXES)} of points (V, 3)"
        )
    return read_rope(Path(text), rope, unit)


def read_rope(path: Path, rope: RopeConfig, unit: str | None = None) -> Floats:
    """A measured rope from a file, resampled to the model's links and laid on the table.

    The file has the points of the rope's centre line, one a row: x, y, z, world frame (z up, any
    table height), head first, at least `MIN_VERTICES`; see `rope_file` for what a CSV may look like
    and for units.
    Where the rope does not cross itself its heights are not used. Where it does, z says which
    strand is on top; a rope whose heights are not those of a rope at rest is lifted at its over
    strands by what its diameter takes.

    Returns:
        (V, 3) in the state of the file's curve.

    Raises:
        RopeInputError: no such file, not (V, 3) finite numbers, too few, another length than the
            model's rope, out of the splines' reach, bent sharper than the model can, or crossings
            that cannot be read or are lost between the model's links.
    """
    curve = read_points(path, unit)
    _check_lies(path, curve)
    try:
        state = TopologicalState.from_curve(curve)
    except DegenerateCurveError as error:
        raise RopeInputError(
            f"{path}: how this rope crosses itself cannot be read when seen from above: {error}."
            " Measure the strands at the crossing more closely: z must say which one is on top, and"
            " neither an end nor two strands may lie exactly on another in x and y"
        ) from error
    length = float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
    if abs(length / rope.length - 1.0) > LENGTH_TOLERANCE:
        raise RopeInputError(
            f"{path}: the rope is {length:.3g} m long, but the model's is {rope.length:g} m; "
            f"{_length_cure(length, rope)}"
        )
    points = lay_down(curve, rope)
    _check_bends(path, points, rope)
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
    """A curve as the model's rope at rest on the table (z = 0).

    Args:
        curve: (N, 3) metres, head first; its state can be read.
        rope: the model's rope.

    Returns:
        (V, 3). Without crossings it lies flat. With crossings that already have the heights of a
        rope at rest, about a diameter apart, it keeps them; else every over strand is lifted.
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


def _check_lies(path: Path, curve: Floats) -> None:
    steps = np.diff(curve, axis=0)
    length = float(np.linalg.norm(steps, axis=1).sum())
    above = float(np.linalg.norm(steps[:, :2], axis=1).sum())
    if above < MIN_VISIBLE * length:
        raise RopeInputError(
            f"{path}: this rope stands or hangs rather than lies: of its {length:.3g} m, "
            f"{above:.3g} m are seen from above. Columns are x, y, z with z up, and the rope lies "
            "on a table"
        )


def _check_bends(path: Path, points: Floats, rope: RopeConfig) -> None:
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


def _state_or_text(points: Floats) -> TopologicalState | str:
    try:
        return TopologicalState.from_curve(points)
    except DegenerateCurveError as error:
        return f"no state ({error})"

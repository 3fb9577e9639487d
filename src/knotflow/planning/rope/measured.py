"""The rope to tie: a generated start, or one that was measured (`files`).

A measured centre line is smoothed, brought to its table, read (`centre_line`), and replaced by the
model rope at rest that lies nearest to it (`fit`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from knotflow.planning.config import RopeOptions
from knotflow.planning.fingers import HandConfig
from knotflow.planning.frame import Frame, Placement
from knotflow.planning.hand import Hand
from knotflow.planning.rope.centre_line import CentreLine, at_crossings
from knotflow.planning.rope.files import (
    ROPE_NAMES,
    RopeInputError,
    RopeTable,
    checked,
    read_table,
)
from knotflow.planning.rope.fit import planar_code, rests
from knotflow.planning.rope.size import RopeSize
from knotflow.simulation import (
    SPLINE_HIGH,
    RopeConfig,
    StartsConfig,
    arc,
    random_curve,
    straight,
)
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats, arc_lengths

FINER, MAX_LINKS = 8, 96  # links more where the shape needs them, and the most there are
SHORTEST_LINK = 1.5  # diameters


@dataclass(frozen=True, eq=False)
class MeasuredRope:
    """A rope to plan for, in units of its length, and where it lies."""

    points: Floats
    """(V, 3) the model rope of 1 m at rest, its middle at the origin."""
    size: RopeSize
    placement: Placement
    frame: Frame
    remarks: tuple[str, ...] = ()
    """What was assumed, changed and found, for printing."""

    @property
    def state(self) -> TopologicalState:
        """Its topological state."""
        return TopologicalState.from_curve(self.points)

    @property
    def model(self) -> RopeConfig:
        """The rope of 1 m that moves alike."""
        return self.size.model(len(self.points) - 1)

    @property
    def rope(self) -> RopeConfig:
        """Its real size."""
        return self.size.rope(len(self.points) - 1)

    @property
    def hand(self) -> Hand:
        """Fingers of the usual size beside the model."""
        return Hand(self.model.radius, HandConfig().scaled(self.size.length))


def measured_rope(
    rope: str | RopeTable, options: RopeOptions, rng: np.random.Generator
) -> MeasuredRope:
    """The rope that a text names (see `parse_rope`) or whose centre line is given, of any size.

    Raises:
        RopeInputError: neither a valid name nor a usable centre line, or options that do not fit.
    """
    if rope in ROPE_NAMES:
        given = {
            "--rope-unit": options.rope_unit is not None,
            "--up": options.up != "z",
            "--cut": options.cut is not None,
            "--crossings": options.crossings is not None,
        }
        if any(given.values()):
            told = ", ".join(name for name, one in given.items() if one)
            raise RopeInputError(f"the rope is {rope}: {told} are for the file of a rope, --rope")
        size = RopeSize.of_options(options)
        points = parse_rope(rope, size.model(), rng)
        return MeasuredRope(points, size, Placement(size.length), Frame(), (size.describe(),))
    if isinstance(rope, str):
        return _measure(read_table(Path(rope), options.rope_unit), options)
    if options.rope_unit is not None:
        raise RopeInputError(f"{rope.name}: --rope-unit is for the file of a rope, --rope")
    return _measure(checked(rope), options)


def parse_rope(
    text: str,
    rope: RopeConfig,
    rng: np.random.Generator,
    starts: StartsConfig | None = None,
) -> Floats:
    """The rope shape (V, 3), metres, that a text names.

    It is "straight", "arc", "random", or the path of a file, see `read_rope`.

    Raises:
        RopeInputError: neither a valid name nor a usable file.
    """
    if text == "random":
        return random_curve(rope, rng, starts or StartsConfig())
    if text in ROPE_NAMES:
        return straight(rope) if text == "straight" else arc(rope)
    return read_rope(Path(text), rope)


def read_rope(path: Path, rope: RopeConfig) -> Floats:
    """A measured rope (V, 3), metres, as the given model rope at rest on the table, z = 0.

    The file has points of the centre line, one a row: x, y, z, z up, head first, any table height.
    At crossings z says which strand is on top.

    Raises:
        RopeInputError: an unreadable file, or a rope that the model cannot be or splines not reach.
    """
    length, diameter = f"{rope.length:.9g}m", f"{2 * rope.radius:.9g}m"
    line = CentreLine.of(read_table(path), RopeOptions(length=length, diameter=diameter))
    points: Floats = line.fit(rope).points + [*line.middle, 0.0]
    reach = float(SPLINE_HIGH[-1])
    far = np.abs(points[:, :2]).max(axis=1)
    if far.max() > reach:
        vertex = int(far.argmax())
        raise RopeInputError(
            f"{path}: vertex {vertex} lies at {points[vertex, :2].round(3).tolist()} m, out of the "
            f"splines' reach of {reach:g} m in x and y; put the origin in the middle of the rope"
        )
    return points


def lay_down(curve: Floats, rope: RopeConfig) -> Floats:
    """The model's rope (V, 3) at rest on the table (z = 0) along a curve (N, 3), metres, head
    first, that is scaled to its length. A shape of this rope at rest stays as it is.

    Raises:
        RopeInputError: the rope would have other crossings than the curve, or lie far from it.
        DegenerateCurveError: the curve's crossings cannot be read.
    """
    curve = np.array(curve, float)
    crossings = planar_code(curve[:, :2])
    earlier, later = at_crossings(curve[:, 2], curve, crossings)
    curve[:, 2] -= np.median(curve[:, 2])
    if not rests(curve + [0.0, 0.0, rope.radius], rope):
        curve[:, 2] = 0.0  # what counts is the length on the table
    line = CentreLine("the curve", curve, crossings, later > earlier)
    points: Floats = line.fit(rope).points + [*line.middle, 0.0]
    return points


def _measure(table: RopeTable, options: RopeOptions) -> MeasuredRope:
    line = CentreLine.of(table, options)
    size = RopeSize.of(line.length, options.diameter, options.stiffness)
    links = size.links
    while True:
        try:
            fit = line.fit(size.model(links))
            break
        except RopeInputError:
            links += FINER
            if links > min(MAX_LINKS, line.length / (SHORTEST_LINK * size.diameter)):
                raise
    assumed = [
        *([] if options.diameter else ["a hundredth of its length thick (--diameter)"]),
        *([] if options.stiffness else ["of medium stiffness (--stiffness)"]),
    ]
    off = 1e3 * line.length * fit.deviations
    told = (
        size.describe() + (f"; taken to be {' and '.join(assumed)}" if assumed else ""),
        f"laid with {links} links, {off.max():.2g} mm off at most, {np.sqrt((off**2).mean()):.2g} "
        f"mm rms; its state is {line.state}",
    )
    # Where it was measured, even if the rope's own length is another one.
    placement = Placement(float(arc_lengths(line.curve)[-1]), *line.middle.tolist())
    return MeasuredRope(fit.points, size, placement, line.frame, (*line.remarks, *told))

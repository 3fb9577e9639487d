"""The rope to tie: a generated start, or one that was measured (see `rope_files`).

A measured centre line is brought to its table, smoothed, read, and replaced by the model rope at
rest that lies nearest to it (`rope_fit`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.config import Axis, RopeOptions
from knotflow.planning.fingers import HandConfig
from knotflow.planning.frame import Frame, Placement
from knotflow.planning.hand import Hand
from knotflow.planning.rope_files import (
    METRES,
    ROPE_NAMES,
    RopeInputError,
    RopeTable,
    checked,
    read_table,
)
from knotflow.planning.rope_fit import Fit, fit_rope, planar_code, rests
from knotflow.planning.rope_size import RopeSize, parse_metres
from knotflow.simulation import (
    SPLINE_HIGH,
    RopeConfig,
    StartsConfig,
    arc,
    random_curve,
    straight,
)
from knotflow.topology import CurveCrossings, DegenerateCurveError, TopologicalState
from knotflow.topology.polyline import Floats, arc_lengths

LENGTH_TOLERANCE = 0.05  # relative difference of a file's rope from a given length
USUAL_LENGTHS = (0.05, 20.0)  # metres; outside, a file has to state its unit
LYING = (6.0, 0.05)
"""Greatest height of a rope that lies on a table: the greater of so many diameters, and of this
share of its length."""
MOST_TILT = np.deg2rad(45.0)  # of the table; beyond, `up` has to be said
CUT_OUT = 0.02  # share of a closed curve that is left out where it is cut
LEAST_GAP = 0.1  # diameters by which the strands of a crossing differ in height at least
DENSE = 100  # points from which on a centre line is smoothed
MOST_NOISE = 0.02  # of smoothed points, in lengths of the rope
MOST_OFF = 0.015  # farthest that a rope may lie from its curve, in its lengths
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
        return MeasuredRope(points, size, Placement(size.length), Frame())
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
    length, diameter = f"{rope.length:.9g}", f"{2 * rope.radius:.9g}"
    line = _CentreLine.of(read_table(path), RopeOptions(length=length, diameter=diameter))
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
    earlier, later = _at_crossings(curve[:, 2], curve, crossings)
    curve[:, 2] -= np.median(curve[:, 2])
    if not rests(curve + [0.0, 0.0, rope.radius], rope):
        curve[:, 2] = 0.0  # what counts is the length on the table
    line = _CentreLine("the curve", curve, crossings, later > earlier)
    points: Floats = line.fit(rope).points + [*line.middle, 0.0]
    return points


def _measure(table: RopeTable, options: RopeOptions) -> MeasuredRope:
    line = _CentreLine.of(table, options)
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


@dataclass(frozen=True, eq=False)
class _CentreLine:
    """A measured centre line on its table.

    Attributes:
        name: of its file or image.
        curve: (N, 3) metres, z above a rope that touches the table.
        crossings: of `planar_code`.
        later_over: (c,) of each crossing, whether its later strand is on top.
        length: of the rope, metres, which may differ from the curve's.
    """

    name: str
    curve: Floats
    crossings: CurveCrossings
    later_over: NDArray[np.bool_]
    length: float = 1.0
    frame: Frame = field(default_factory=Frame)
    remarks: tuple[str, ...] = ()

    @classmethod
    def of(cls, table: RopeTable, options: RopeOptions) -> _CentreLine:
        """The errors are those of `measured_rope`."""
        table, smoothed = _smoothed(table)
        table, cut = _cut(table, options.cut)
        points = table.points
        length = _length(table, options.length)
        thick = RopeSize.of(length, options.diameter).diameter
        frame, tilted = _table_frame(table, options.up, length, thick)
        frame = replace(frame, unit=table.unit or "m")
        if points.shape[1] == 3:
            points = points @ frame.rotation - [0.0, 0.0, frame.height + thick / 2]
        else:
            points = np.pad(points, ((0, 0), (0, 1)))
        try:
            crossings = planar_code(points[:, :2])
        except DegenerateCurveError as error:
            raise RopeInputError(
                f"{table.name}: how this rope crosses itself cannot be read when seen from above: "
                f"{error}. Neither an end nor two strands may lie exactly on another in x and y"
            ) from error
        later = _later_over(points, crossings, table, options.crossings, thick)
        remarks = (*smoothed, *cut, *tilted)
        return cls(table.name, points, crossings, later, length, frame, remarks)

    @property
    def middle(self) -> Floats:
        """(2,) of the curve in x and y, metres."""
        xy = self.curve[:, :2]
        return np.asarray((xy.min(axis=0) + xy.max(axis=0)) / 2)

    @property
    def state(self) -> TopologicalState:
        """Its topological state."""
        return TopologicalState.from_crossings(
            (over, under, sign) if later else (under, over, -sign)
            for (over, under, sign), later in zip(
                self.crossings.crossings, self.later_over, strict=True
            )
        )

    def fit(self, rope: RopeConfig) -> Fit:
        """The nearest model rope at rest, its middle at the origin.

        Raises:
            RopeInputError: it would have other crossings, or lie far from the curve.
        """
        scale = rope.length / float(arc_lengths(self.curve)[-1])
        curve = scale * (self.curve - [*self.middle, 0.0]) + [0.0, 0.0, rope.radius]
        if rests(curve, rope):
            return Fit(curve, np.zeros(len(curve)), True)
        try:
            fit = fit_rope(curve[:, :2], self.later_over, rope)
            keeps = fit.keeps and TopologicalState.from_curve(fit.points) == self.state
        except DegenerateCurveError:
            keeps = False
        if keeps and fit.deviations.max() <= MOST_OFF * rope.length:
            return fit
        metres = self.length / rope.length
        thick, link = (1e3 * metres * size for size in (2 * rope.radius, rope.link_length))
        raise RopeInputError(
            f"{self.name}: a rope of {thick:.3g} mm in {rope.links} links of {link:.3g} mm "
            + (
                f"lies at least {1e3 * metres * fit.deviations.max():.2g} mm off these points"
                if keeps
                else f"cannot lie with these {len(self.later_over)} crossings, {self.state}"
            )
            + ": they are tighter than a rope of this size bends; give --diameter, the rope's own. "
            "Points that are noisy or out of order look alike"
        )


def _cut(table: RopeTable, cut: int | str | None) -> tuple[RopeTable, tuple[str, ...]]:
    """The table of an open curve, and what was done to it."""
    points = table.points
    step = float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    apart = float(np.linalg.norm(points[0] - points[-1]))
    few = max(1, len(points) // 20)
    onward = (points[few] - points[0]) @ (points[-1] - points[-1 - few]) > 0
    rows = table.rows
    assert rows is not None
    closed = table.closed or (apart <= 1.5 * step and (onward or apart <= 1e-6 * step))
    if cut == "open" or (cut is None and not closed):
        return table, ()
    if cut is None:
        raise RopeInputError(
            f"{table.name}: a closed curve: its last point is {1e3 * apart:.2g} mm from the first, "
            "as neighbours are; a rope has two ends: say at which point (0 to "
            f"{rows[-1]:.0f}) it is to be cut, as in --cut 0, or that it is open: --cut open"
        )
    if not closed or not 0 <= int(cut) <= rows[-1]:
        raise RopeInputError(
            f"{table.name}: --cut {cut}: "
            + (f"its points are 0 to {rows[-1]:.0f}" if closed else "its curve is open already")
        )
    first = int(np.abs(rows - int(cut)).argmin())
    kept = np.roll(np.arange(len(points) - (apart <= 1e-6 * step)), -first)
    kept = kept[: -max(1, round(CUT_OUT * len(kept)))]
    over = None if table.over is None else table.over[kept]
    told = (f"cut at point {cut}, {CUT_OUT:.0%} of the curve before it left out",)
    return replace(table, points=points[kept], over=over), told


def _smoothed(table: RopeTable) -> tuple[RopeTable, tuple[str, ...]]:
    """The table without the noise of dense points, which generalised cross-validation tells."""
    points = table.points
    if len(points) < DENSE:
        return table, ()
    bends = np.diff(np.eye(len(points)), n=2, axis=0)
    rough, modes = np.linalg.eigh(bends.T @ bends)
    shares = modes.T @ points  # (N, D) of the modes, from smooth to rough
    damped = 1.0 - 1.0 / (1.0 + np.logspace(-6, 14, 81)[:, None] * np.maximum(rough, 0.0))
    score = (damped**2 @ shares**2) / damped.sum(axis=1, keepdims=True) ** 2
    smooth = modes @ (shares * (1.0 - damped[score.argmin(axis=0)].T))
    noise = float(np.sqrt(((smooth - points) ** 2).mean()))
    length = float(arc_lengths(smooth)[-1])
    if noise > MOST_NOISE * length:
        raise RopeInputError(
            f"{table.name}: these points are no line: they lie {1e3 * noise:.3g} mm (rms) off any "
            "smooth curve through them in the file's order. Of a cloud of points, keep the centre "
            "line, ordered from head to tail"
        )
    if noise < 1e-4 * length:  # rounding
        return table, ()
    told = f"smoothed: its points are {1e3 * noise:.2g} mm (rms) off a smooth curve"
    return replace(table, points=smooth), (told,)


def _length(table: RopeTable, text: str | None) -> float:
    """The rope's length, metres: as given by a text, or that of its points."""
    length = float(arc_lengths(table.points)[-1])
    given = length if text is None else parse_metres(text, "--length")
    usual = text or table.unit or USUAL_LENGTHS[0] <= length <= USUAL_LENGTHS[1]
    if usual and abs(length / given - 1.0) <= LENGTH_TOLERANCE:
        return given
    expected = "" if text is None else f", not {given:.3g} m"
    in_file = length / METRES[table.unit or "m"]
    units = (f"{unit} ({in_file * metres:.3g} m)" for unit, metres in METRES.items())
    raise RopeInputError(
        f"{table.name}: this rope would be {length:.3g} m long{expected}: give its --length, or "
        f"--rope-unit {', '.join(units)}"
    )


def _table_frame(
    table: RopeTable, up: str, length: float, thick: float
) -> tuple[Frame, tuple[str, ...]]:
    """The frame of the table on which the points lie, and what is to be said of it."""
    from scipy.spatial.transform import Rotation  # slow to import

    points = table.points
    if points.shape[1] == 2:
        if up != "z":
            raise RopeInputError(f"{table.name}: has no z, so that --up {up} says nothing of it")
        return Frame(), ()
    axis = "xyz".index(up[-1])
    rotation = np.roll(np.eye(3), -1 - axis, axis=1)
    if up[0] == "-":
        rotation = rotation * [1, -1, -1]
    heights = points @ rotation[:, 2]
    highest = max(LYING[0] * thick, LYING[1] * length)
    told: tuple[str, ...] = ()
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    normal = axes[2] * np.sign(axes[2] @ rotation[:, 2] or 1.0)
    cosine = float(normal @ rotation[:, 2])
    across = np.ptp(points @ normal)
    flat = across <= highest and spread[1] > 3 * thick * np.sqrt(len(points))
    tilted = flat and np.ptp(heights) > 2 * max(thick, across)
    if np.ptp(heights) > highest or tilted:
        if not flat or cosine < np.cos(MOST_TILT):
            tilt = f"; their plane is {np.rad2deg(np.arccos(cosine)):.0f} degrees from level"
            raise RopeInputError(
                f"{table.name}: this rope stands or hangs rather than lies: its points are "
                f"{heights.min():.2f} to {heights.max():.2f} m high ({up}), but those of a rope of "
                f"{length:.3g} m that lies on a table differ by {highest:.2g} m at most"
                f"{tilt if flat else ''}. Where another axis points up from the table, say which: "
                f"--up {', '.join(get_args(Axis))} (with =, as in --up=-z)"
            )
        turn, _ = Rotation.align_vectors(normal, rotation[:, 2])
        rotation = turn.as_matrix() @ rotation
        heights = points @ normal
        told = (
            f"the table is the plane of the points, tilted by {np.rad2deg(np.arccos(cosine)):.1f} "
            f"degrees; {up} is on its upper side",
        )
    return Frame(rotation, float(np.median(heights)) - thick / 2), told


def _at_crossings(values: Floats, curve: Floats, crossings: CurveCrossings) -> Floats:
    """(2, c) of the earlier and the later strand, of values (N,) at the points of a curve."""
    along = arc_lengths(curve[:, :2])
    positions = np.array([one[1::-1] for one in crossings.crossings], int).reshape(-1, 2) - 1
    return np.asarray(np.interp(crossings.fractions[positions.T] * along[-1], along, values))


def _later_over(
    points: Floats,
    crossings: CurveCrossings,
    table: RopeTable,
    text: str | None,
    thick: float,
) -> NDArray[np.bool_]:
    """(c,) whether the later strand of each crossing is on top: by text, by a column, or by z."""
    either = [
        (f"{later}o{earlier}{'-+'[sign > 0]}", f"{earlier}o{later}{'+-'[sign > 0]}")
        for later, earlier, sign in crossings.crossings
    ]
    choices = ", ".join(" or ".join(pair) for pair in either) or "none"
    if text is not None:
        named = {f"{o}o{u}{'-+'[s > 0]}" for o, u, s in TopologicalState.parse(text).crossings}
        if len(named) != len(either) or not all(named & {*pair} for pair in either):
            raise RopeInputError(
                f"{table.name}: --crossings {text} are not this curve's; seen from above it has "
                f"{choices}"
            )
        return np.array([pair[0] in named for pair in either], bool)
    if not either:
        return np.zeros(0, bool)
    cure = f"give a column over (1 on upper strands), or --crossings: {choices}"
    if table.over is not None:
        column, values, least = "over", table.over, 0.0
    elif table.points.shape[1] == 3:
        column, values, least = "z", points[:, 2], LEAST_GAP * thick
    else:
        raise RopeInputError(
            f"{table.name}: has no z, and crosses itself {len(either)} times when seen from above; "
            f"which strand is on top? Add z, or {cure}"
        )
    earlier, later = _at_crossings(values, points, crossings)
    gaps = np.abs(later - earlier)
    if (closest := gaps.min()) <= least:
        raise RopeInputError(
            f"{table.name}: {column} must say which strand of "
            f"{' or '.join(either[gaps.argmin()])} is on top, and differ "
            f"by more than {least:.2g}, but differs by {closest:.2g}; or {cure}"
        )
    return np.asarray(later > earlier)

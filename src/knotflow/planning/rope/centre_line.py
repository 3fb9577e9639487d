"""A measured centre line: smoothed, cut open, brought to its table, and its crossings read."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.config import Axis, RopeOptions
from knotflow.planning.frame import METRES, Frame
from knotflow.planning.rope.files import RopeInputError, RopeTable
from knotflow.planning.rope.fit import Fit, fit_rope, planar_code, rests
from knotflow.planning.rope.size import LENGTHS, USUAL_LENGTHS, RopeSize, parse_length
from knotflow.simulation import RopeConfig
from knotflow.topology import CurveCrossings, DegenerateCurveError, TopologicalState
from knotflow.topology.polyline import Floats, arc_lengths

LENGTH_TOLERANCE = 0.05  # relative difference of a file's rope from a given length
LYING = (6.0, 0.05)
"""Greatest height of a rope that lies on a table: the greater of so many diameters, and of this
share of its length."""
MOST_TILT = np.deg2rad(45.0)  # of the table; beyond, `up` has to be said
CUT_OUT = 0.02  # share of a closed curve that is left out where it is cut
LEAST_GAP = 0.1  # diameters by which the strands of a crossing differ in height at least
DENSE = 100  # points from which on a centre line is smoothed,
MIN_SMOOTHED, NOISY_TURN = 40, 0.5  # or so many with this median angle between steps, radians
MIN_ORDERED = 12  # points, of which the order is judged
MOST_TURN = 1.8  # median angle between steps of points in order, radians
MOST_NOISE = 0.02  # of smoothed points, in lengths of the rope
MOST_NAMED = 12  # crossings in a message
MOST_OFF = 0.015  # farthest that a rope may lie from its curve, in its lengths


@dataclass(frozen=True, eq=False)
class CentreLine:
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
    def of(cls, table: RopeTable, options: RopeOptions) -> CentreLine:
        """The errors are those of `measured_rope`."""
        _check_order(table)
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
        try:
            if rests(curve, rope) and TopologicalState.from_curve(curve) == self.state:
                return Fit(curve, np.zeros(len(curve)), True)
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


def _check_order(table: RopeTable) -> None:
    """Raises `RopeInputError` where the points turn more than those of a line do."""
    turn = _median_turn(table.points)
    if MIN_ORDERED <= len(table.points) < DENSE and turn > MOST_TURN:
        raise RopeInputError(
            f"{table.name}: points out of order: at each the line through them turns by "
            f"{np.rad2deg(turn):.0f} degrees (median). Order them from head to tail"
        )


def _median_turn(points: Floats) -> float:
    """Median angle between successive steps of a line (N, D), radians."""
    steps = np.diff(points, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    return float(np.median(np.arccos(np.clip((steps[1:] * steps[:-1]).sum(axis=1), -1.0, 1.0))))


def _smoothed(table: RopeTable) -> tuple[RopeTable, tuple[str, ...]]:
    """The table without the noise of dense points, or of fewer that turn much, which generalised
    cross-validation tells."""
    points = table.points
    if len(points) < DENSE and (len(points) < MIN_SMOOTHED or _median_turn(points) < NOISY_TURN):
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
    given = length if text is None else parse_length(text)
    low, high = LENGTHS if text or table.unit else USUAL_LENGTHS
    if low <= given <= high and abs(length / given - 1.0) <= LENGTH_TOLERANCE:
        return given
    in_file = length / METRES[table.unit or "m"]
    units = (f"{unit} ({in_file * metres:.3g} m)" for unit, metres in METRES.items())
    expected = "" if text is None else f", not {given:.3g} m"
    near = "" if text is None else f" within {LENGTH_TOLERANCE:.0%} or none"
    raise RopeInputError(
        f"{table.name}: this rope would be {length:.3g} m long{expected}: give its --length{near}, "
        f"or --rope-unit {', '.join(units)}"
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


def at_crossings(values: Floats, curve: Floats, crossings: CurveCrossings) -> Floats:
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
    choices = ", ".join(" or ".join(pair) for pair in either[:MOST_NAMED]) or "none"
    if len(either) > MOST_NAMED:
        choices += f" and {len(either) - MOST_NAMED} others"
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
    earlier, later = at_crossings(values, points, crossings)
    gaps = np.abs(later - earlier)
    if (closest := gaps.min()) <= least:
        raise RopeInputError(
            f"{table.name}: {column} must say which strand of "
            f"{' or '.join(either[gaps.argmin()])} is on top, and differ "
            f"by more than {least:.2g}, but differs by {closest:.2g}; or {cure}"
        )
    return np.asarray(later > earlier)

"""The model rope at rest that lies nearest to a curve on the table and keeps its crossings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation import RopeConfig
from knotflow.topology import CurveCrossings, DegenerateCurveError, project
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

SAMPLES = 4  # points of the curve that a link is fitted to
STIFFNESS = 0.03  # links that a point may be off for a radian by which neighbouring bends differ
GAP = 2.5  # radii between the centre lines of the strands of a crossing
RISE = 0.07
"""Radians a radius by which the rope bends upward to a crossing; more where there is no room."""
ALIKE = 0.01  # relative difference of the links of a shape of the model rope


class Fit(NamedTuple):
    """A rope at rest, and how far its curve lies from it."""

    points: Floats  # (V, 3) metres
    deviations: Floats  # (M,) metres
    keeps: bool  # whether it has the curve's crossings


def planar_code(xy: Floats) -> CurveCrossings:
    """The crossings of a curve (N, 2) as if every later strand were on top.

    Raises:
        DegenerateCurveError: they cannot be read.
    """
    later = np.linspace(0.0, 1e-3 * float(arc_lengths(xy)[-1]), len(xy))
    return project(np.column_stack([xy, later]), min_gap=0.0)


def fit_rope(curve: Floats, later_over: NDArray[np.bool_], rope: RopeConfig) -> Fit:
    """The rope (V, 3) with bends within its limits along a curve (N, 2) of its length, metres.

    `later_over` (c,) says of each crossing of `planar_code` whether the later strand is on top.

    Raises:
        DegenerateCurveError: the crossings of the fitted rope cannot be read.
    """
    along = arc_lengths(curve) / arc_lengths(curve)[-1]
    places = np.linspace(0.0, 1.0, SAMPLES * rope.links + 1)
    targets = interpolate(places, along, curve)
    wanted = planar_code(curve).crossings
    heights = np.full(rope.num_vertices, rope.radius)
    for _ in range(2):
        # Where the rope rises, less of a link is seen from above.
        spans = np.sqrt(rope.link_length**2 - np.diff(heights) ** 2)
        xy = _chain(targets, places, spans, rope)
        found = planar_code(xy)
        if found.crossings != wanted:
            break
        if np.ptp(heights) == 0:
            heights = _heights(found, later_over, rope)
            if np.abs(np.diff(heights)).max() >= rope.link_length:  # the links are too short
                return Fit(np.column_stack([xy, heights]), np.zeros(len(targets)), False)
    fitted = interpolate(places * rope.links, np.arange(len(xy)), xy)
    off = np.linalg.norm(fitted - targets, axis=1)
    return Fit(np.column_stack([xy, heights]), off, found.crossings == wanted)


def rests(curve: Floats, rope: RopeConfig) -> bool:
    """Whether a curve (N, 3), metres, is a shape of the rope at rest on the table."""
    if curve.shape != (rope.num_vertices, 3):
        return False
    links = np.diff(curve, axis=0)
    lengths = np.linalg.norm(links, axis=1)
    cosines = (links[1:] * links[:-1]).sum(axis=1) / (lengths[1:] * lengths[:-1])
    if np.ptp(lengths) > ALIKE * rope.link_length or cosines.min() < np.cos(rope.max_bend):
        return False
    try:
        heights = project(curve, min_gap=1.5 * rope.radius).heights
    except DegenerateCurveError:
        return False
    low = 6.0 * rope.radius  # three strands on top of each other
    return bool(np.ptp(curve[:, 2]) <= (low if len(heights) else 0.1 * rope.radius))


def _chain(targets: Floats, places: Floats, spans: Floats, rope: RopeConfig) -> Floats:
    """Vertices (V, 2) of links of lengths `spans` (n,) nearest to points (M, 2) at fractions
    `places` (M,): least squares in the first vertex, the first heading and the bends."""
    from scipy.optimize import least_squares

    links = len(spans)
    # (M, n) how much of each link lies before each place
    before = np.clip(places[:, None] * links - np.arange(links), 0.0, 1.0)
    ends = np.linspace(0.0, 1.0, links + 1)
    chords = np.diff(interpolate(ends, places, targets), axis=0).T
    headings = np.unwrap(np.arctan2(chords[1], chords[0]))
    limit = 0.95 * rope.max_bend
    bends = np.clip(np.diff(headings), -0.99 * limit, 0.99 * limit)
    smooth = STIFFNESS * np.diff(np.eye(links - 1), axis=0)  # (n - 2, n - 1)

    def links_of(values: Floats) -> Floats:
        """(2, n) links of a chain: x and y of its head, heading, and n - 1 bends."""
        turned = np.cumsum(values[2:])
        return np.asarray(spans * np.array([np.cos(turned), np.sin(turned)]))

    def residuals(values: Floats) -> Floats:
        off = values[:2, None] + links_of(values) @ before.T - targets.T  # (2, M)
        return np.concatenate([off.ravel() / rope.link_length, smooth @ values[3:]])

    bound = np.r_[np.full(3, np.inf), np.full(links - 1, limit)]
    first = np.r_[targets[0], headings[0], bends]
    found = least_squares(residuals, first, bounds=(-bound, bound), ftol=1e-4).x
    return np.cumsum(np.concatenate([found[None, :2], links_of(found).T]), axis=0)


def _heights(crossings: CurveCrossings, later_over: NDArray[np.bool_], rope: RopeConfig) -> Floats:
    """The lowest heights (V,) of a rope on the table whose strands are apart at crossings."""
    from scipy.optimize import linprog

    count = rope.num_vertices
    later, earlier = np.array([one[:2] for one in crossings.crossings], int).reshape(-1, 2).T - 1
    over = crossings.fractions[np.where(later_over, later, earlier)]
    under = crossings.fractions[np.where(later_over, earlier, later)]
    if not len(over):
        return np.full(count, rope.radius)

    def weights(fractions: Floats) -> Floats:
        """(c, V) shares of the vertices in the height at fractions (c,) of the rope."""
        return np.clip(1.0 - np.abs(fractions[:, None] * rope.links - np.arange(count)), 0.0, 1.0)

    rise = np.diff(np.eye(count), n=2, axis=0) / rope.link_length
    apart, steeper = np.zeros((len(over), 1)), np.full((len(rise), 1), -1.0)  # of the last unknown:
    # by how much more than `RISE` a link has to bend.
    rows = np.block([[weights(under) - weights(over), apart], [rise, steeper], [-rise, steeper]])
    bent = np.full(2 * len(rise), RISE * rope.link_length / rope.radius)
    limits = np.r_[np.full(len(over), -GAP * rope.radius), bent]
    bounds = [(rope.radius, None)] * count + [(0.0, None)]
    found = linprog(np.r_[np.ones(count), 1e3], rows, limits, bounds=bounds).x
    return np.asarray(found[:-1])

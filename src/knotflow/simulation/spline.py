"""The robot's action: a 6-D spline (Sec. V).

| number | name                              | unit                | range         |
|--------|-----------------------------------|---------------------|---------------|
| 0      | grasp position along the rope     | fraction from head  | 0 to 1        |
| 1, 2   | middle control point, x and y     | m, world frame      | -0.6 to 0.6   |
| 3      | height at which the rope is moved | m above the table   | 0.02 to 0.20  |
| 4, 5   | end point on the table, x and y   | m, world frame      | -0.6 to 0.6   |

Seen from above, the path is a cubic B-spline whose control points are the grasped point of the rope
three times, the middle one once, and the end three times. The gripper rises along it at 45 degrees
to the height, stays level, and comes down at 45 degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.arrays import floats
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

SPLINE_NAMES = ("grasp", "mid_x", "mid_y", "height", "end_x", "end_y")
SPLINE_LOW = np.array([0.0, -0.6, -0.6, 0.02, -0.6, -0.6])
SPLINE_HIGH = np.array([1.0, 0.6, 0.6, 0.20, 0.6, 0.6])
SAMPLES = 129
"""Points of the polyline that stands for a path."""


class SplineError(ValueError):
    """A spline that is out of range or has another shape."""


def check_splines(splines: ArrayLike) -> Floats:
    """The splines as float64 (..., 6), if all are in range.

    Raises:
        SplineError: another shape, or a number out of range.
    """
    splines = _as_splines(splines)
    inside = (splines >= SPLINE_LOW) & (splines <= SPLINE_HIGH)  # NaN is not inside
    if not inside.all():
        *row, column = np.argwhere(~inside)[0].tolist()
        value = splines[(*row, column)]
        cure = "" if np.isnan(value) else "; clip_splines() brings splines into range"
        raise SplineError(
            f"spline{row} has {SPLINE_NAMES[column]} = {value:.4g}, which must lie in "
            f"[{SPLINE_LOW[column]:g}, {SPLINE_HIGH[column]:g}]{cure}"
        )
    return splines


def clip_splines(splines: ArrayLike) -> Floats:
    """The nearest splines (..., 6) that are in range; NaN stays NaN.

    Raises:
        SplineError: they have another shape.
    """
    return np.clip(_as_splines(splines), SPLINE_LOW, SPLINE_HIGH)


def _as_splines(splines: ArrayLike) -> Floats:
    splines = floats(splines, "splines", SplineError)
    if splines.shape[-1:] != (6,):
        raise SplineError(f"splines have shape (..., 6), got {splines.shape}")
    return splines


def grasped_link(splines: ArrayLike, links: int) -> NDArray[np.intp]:
    """Index (...,) of the link that each spline (..., 6) grasps: the one at its position."""
    return np.minimum((np.asarray(splines)[..., 0] * links).astype(np.intp), links - 1)


def control_points(points: ArrayLike, splines: ArrayLike, radius: ArrayLike) -> Floats:
    """Control points (..., 3, 3) of splines (..., 6) on ropes (..., V, 3) or one (V, 3), metres.

    The first is the centre of the grasped link, the last is `radius` (...) or () above the table.
    """
    points, splines = np.asarray(points, float), np.asarray(splines, float)
    points = np.broadcast_to(points, (*splines.shape[:-1], *points.shape[-2:]))
    link = grasped_link(splines, points.shape[-2] - 1)[..., None, None]
    first = (
        np.take_along_axis(points, link, axis=-2) + np.take_along_axis(points, link + 1, axis=-2)
    )[..., 0, :] / 2
    low = np.broadcast_to(np.asarray(radius, float), splines.shape[:-1])
    last = np.concatenate([splines[..., 4:6], low[..., None]], -1)
    return np.stack([first, splines[..., 1:4], last], axis=-2)


def spline_basis(parameters: ArrayLike) -> Floats:
    """Weights (N, 3) of grasp, middle and end in the plane, at parameters (N,) from 0 to 1."""
    t = 4 * np.asarray(parameters, float)[:, None]
    # The middle control point's uniform cubic B-spline, on its four segments.
    one, two, three, four = t[:, 0], t[:, 0] - 1, t[:, 0] - 2, 4 - t[:, 0]
    middle = (
        np.select(
            [one < 1, one < 2, one < 3],
            [one**3, 1 + 3 * two + 3 * two**2 - 3 * two**3, 4 - 6 * three**2 + 3 * three**3],
            four**3,
        )
        / 6
    )
    # Those of the grasp add up to one minus the rest, and mirror those of the end.
    end = np.select(
        [one < 1, one < 2, one < 3],
        [0 * one, two**3 / 6, (1 + 3 * three + 3 * three**2 - 2 * three**3) / 6],
        1 - four**3 / 6,
    )
    return np.stack([1 - middle - end, middle, end], axis=-1)


def polyline(controls: ArrayLike) -> Floats:
    """Paths (..., SAMPLES, 3), metres, of splines with control points (..., 3, 3)."""
    controls = np.asarray(controls, float)
    plane = spline_basis(np.linspace(0, 1, SAMPLES)) @ controls[..., :2]
    along = arc_lengths(plane)
    first, height, last = (controls[..., i, 2, None] for i in range(3))
    left = along[..., -1:] - along
    rising = np.minimum(first + along, last + left)
    level = np.maximum(height, np.maximum(first, last))
    # A drop that is steeper than 45 degrees, from a rope that lies high, is a straight one.
    straight = first + (last - first) * along / np.maximum(along[..., -1:], 1e-9)
    z = np.maximum(np.minimum(rising, level), straight)
    return np.concatenate([plane, z[..., None]], axis=-1)


def spline_path(controls: ArrayLike, shares: ArrayLike) -> Floats:
    """Positions (..., N, 3) at shares (N,), 0 to 1, of paths with control points (..., 3, 3)."""
    paths = polyline(controls)
    found = [along_path(path, np.asarray(shares)) for path in paths.reshape(-1, SAMPLES, 3)]
    return np.reshape(found, (*paths.shape[:-2], np.shape(shares)[-1], 3))


def along_path(path: Floats, shares: Floats) -> Floats:
    """Positions (N, 3) at shares (N,) of the length of a polyline (P, 3), 0 to 1."""
    reached = arc_lengths(path)
    reached /= np.maximum(reached[-1:], 1e-12)
    return interpolate(shares, reached, path)

"""The robot's action: a 6-D spline (Sec. V).

| number | name                              | unit                | range         |
|--------|-----------------------------------|---------------------|---------------|
| 0      | grasp position along the rope     | fraction from head  | 0 to 1        |
| 1, 2   | middle control point, x and y     | m, world frame      | -0.6 to 0.6   |
| 3      | middle control point, z           | m above the table   | 0.02 to 0.30  |
| 4, 5   | end point on the table, x and y   | m, world frame      | -0.6 to 0.6   |

The first control point is the grasped point of the rope, the last lies on the table. The clamped
quadratic B-spline of three control points is their quadratic Bezier curve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.arrays import floats

Floats = NDArray[np.float64]

SPLINE_NAMES = ("grasp", "mid_x", "mid_y", "mid_z", "end_x", "end_y")
SPLINE_LOW = np.array([0.0, -0.6, -0.6, 0.02, -0.6, -0.6])
SPLINE_HIGH = np.array([1.0, 0.6, 0.6, 0.30, 0.6, 0.6])


class SplineError(ValueError):
    """A spline that is out of range or has another shape."""


def check_splines(splines: ArrayLike) -> Floats:
    """The splines as float64 (..., 6), if all are in range.

    Raises:
        SplineError: naming the first number that is out of range.
    """
    splines = _as_splines(splines)
    inside = (splines >= SPLINE_LOW) & (splines <= SPLINE_HIGH)  # NaN is not inside
    if not inside.all():
        *row, column = np.argwhere(~inside)[0].tolist()
        raise SplineError(
            f"spline{row} has {SPLINE_NAMES[column]} = {splines[(*row, column)]:.4g}, which must "
            f"lie in [{SPLINE_LOW[column]:g}, {SPLINE_HIGH[column]:g}]; clip_splines() brings "
            "splines into range"
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


def control_points(points: ArrayLike, splines: ArrayLike, radius: float) -> Floats:
    """Control points (..., 3, 3) of splines (..., 6) on ropes (..., V, 3) or one (V, 3), metres.

    The first is the centre of the grasped link, the last is `radius` above the table.
    """
    points, splines = np.asarray(points, float), np.asarray(splines, float)
    points = np.broadcast_to(points, (*splines.shape[:-1], *points.shape[-2:]))
    link = grasped_link(splines, points.shape[-2] - 1)[..., None, None]
    first = (
        np.take_along_axis(points, link, axis=-2) + np.take_along_axis(points, link + 1, axis=-2)
    )[..., 0, :] / 2
    last = np.concatenate([splines[..., 4:6], np.full((*splines.shape[:-1], 1), radius)], -1)
    return np.stack([first, splines[..., 1:4], last], axis=-2)


def spline_path(controls: ArrayLike, parameters: ArrayLike) -> Floats:
    """Positions (..., N, 3) on clamped quadratic B-splines with control points (..., 3, 3).

    `parameters` (N,) run from 0 (grasp) to 1 (release).
    """
    path: Floats = spline_basis(parameters) @ np.asarray(controls)
    return path


def spline_basis(parameters: ArrayLike) -> Floats:
    """Weights (N, 3) of the control points at parameters (N,), 0 (grasp) to 1 (release)."""
    t = np.asarray(parameters)
    return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=-1)

"""How a rope goes on from one image to the next, without a learned model of its dynamics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.fitting import project_lengths

Floats = NDArray[np.float64]

_LONGEST = 0.2  # seconds that a velocity holds: the table's friction stops a rope sooner
_STIFF = 1e-3  # mobility of the held link beside that of the others


def go_on(
    points: Floats, velocities: Floats, seconds: float, gripper: Floats | None, grasped: int | None
) -> Floats:
    """A held rope moves on at constant velocity, its held link to the gripper; a rope that is let
    go stays where it is.

    Args:
        points: (V, 3) metres, world frame.
        velocities: (V, 3) metres a second.
        seconds: until the prediction.
        gripper: (3,) metres, where the gripper is then; None holds nothing.
        grasped: index of the link whose centre it holds.

    Returns:
        (V, 3) metres, with links as long as before on average.
    """
    if gripper is None or grasped is None:
        return points.copy()
    moved = points + velocities * min(seconds, _LONGEST)
    ends = slice(grasped, grasped + 2)
    moved[ends] += gripper - moved[ends].mean(axis=0)
    mobility = np.ones(len(points))
    mobility[ends] = _STIFF
    link = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
    return project_lengths(moved, link, mobility)

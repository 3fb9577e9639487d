"""Times of paths of joints, within an arm's speeds and accelerations.

A trajectory controller moves along cubics through positions and velocities. Limits hold on these,
not just between the waypoints.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from knotflow.execution.arm.model import Arm

STRETCHES, MOST_STRETCH = 200, 1.05  # rounds, and by how much an interval grows in each
SUBDIVISIONS = 8  # samples from one waypoint to the next


def keep_limits(arm: Arm, joints: NDArray, intervals: NDArray) -> CubicSpline:
    """The cubic spline from rest to rest through joints (N, n), N > 1, radians over seconds from 0.

    `intervals` (N - 1,) from one to the next, seconds, are stretched where the spline is beyond
    the arm's limits, until it is nowhere; last by one factor for all, if some are left.
    """
    intervals = np.array(intervals, np.float64)
    for _ in range(STRETCHES):
        curve = rest_to_rest(np.r_[0.0, np.cumsum(intervals)], joints)
        excess = _excess(arm, curve)
        if excess.max() <= 1.0:
            return curve
        intervals *= np.clip(excess, 1.0, MOST_STRETCH)
    curve = rest_to_rest(np.r_[0.0, np.cumsum(intervals)], joints)
    return rest_to_rest(curve.x * max(1.0, float(_excess(arm, curve).max())), joints)


def rest_to_rest(times: NDArray, values: NDArray) -> CubicSpline:
    """The cubic spline through values (N, d) at times (N,), at rest at both ends."""
    return CubicSpline(times, values, bc_type="clamped")


def samples(curve: CubicSpline) -> NDArray[np.float64]:
    """(M,) times, the knots among them, `SUBDIVISIONS` from one to the next."""
    knots = np.arange(len(curve.x))
    return np.interp(np.arange((len(knots) - 1) * SUBDIVISIONS + 1) / SUBDIVISIONS, knots, curve.x)


def _excess(arm: Arm, curve: CubicSpline) -> NDArray[np.float64]:
    """(N - 1,) by how much longer each interval would have to be."""
    speeds = np.abs(curve(samples(curve)[:-1], 1)) / arm.max_speed
    speed = speeds.reshape(len(curve.x) - 1, -1).max(axis=1)
    # Accelerations are linear between the knots.
    acceleration = (np.abs(curve(curve.x, 2)) / arm.max_acceleration).max(axis=1)
    return np.maximum(speed, np.sqrt(np.maximum(acceleration[:-1], acceleration[1:])))

"""When an arm passes its configurations: joint speeds and accelerations, and the tip's speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.arm import Arm
from knotflow.execution.reach import Reached
from knotflow.planning import Waypoints

_PARTS = 8  # of the way between two waypoints, at which the tip's pace is measured


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """N configurations in time, at rest between phases.

    Attributes:
        arm: which moves.
        waypoints: which it follows; their times are those before joints limited them.
        reached: how closely.
        times: (N,) seconds, increasing.
    """

    arm: Arm
    waypoints: Waypoints
    reached: Reached
    times: NDArray[np.float64]

    @property
    def unreachable(self) -> NDArray[np.intp]:
        """Numbers of the waypoints that are not reached, counted from 0."""
        return np.flatnonzero(~self.reached.ok)

    @property
    def joint_speeds(self) -> NDArray[np.float64]:
        """(N, n) velocities, rad/s (m/s); 0 where a phase ends."""
        return self._rates(self.reached.joints)

    @property
    def tip_speeds(self) -> NDArray[np.float64]:
        """(N, 3) velocities of the tip, m/s; 0 where a phase ends."""
        return self._rates(self.reached.positions)

    def peaks(self) -> dict[str, float]:
        """Peak tip speed (m/s) and acceleration (m/s^2), and joints' as shares of their limits."""
        share = {"tip_speed": 0.0, "tip_acceleration": 0.0, "joint_speed": 0.0}
        share["joint_acceleration"] = 0.0
        for rows in _phases(self.waypoints):
            seconds = float(self.times[rows[1]] - self.times[rows[0]]) if len(rows) > 1 else 1.0
            tip = _peaks(self.reached.positions[rows], seconds)
            joints = _peaks(self.reached.joints[rows], seconds)
            found = {
                "tip_speed": float(np.linalg.norm(tip[0], axis=1).max(initial=0.0)),
                "tip_acceleration": float(np.linalg.norm(tip[1], axis=1).max(initial=0.0)),
                "joint_speed": _share(joints[0], self.arm.max_speed),
                "joint_acceleration": _share(joints[1], self.arm.max_acceleration),
            }
            share = {name: max(value, found[name]) for name, value in share.items()}
        return share

    def _rates(self, values: NDArray) -> NDArray[np.float64]:
        if len(values) < 2:
            return np.zeros_like(values)
        rates: NDArray[np.float64] = np.gradient(values, self.times, axis=0)
        rates[[rows[-1] for rows in _phases(self.waypoints)]] = 0.0
        return rates


def time_joints(
    arm: Arm, waypoints: Waypoints, reached: Reached, max_speed: float
) -> JointTrajectory:
    """Give each phase the time that tip and joints need: the waypoints' own, or longer.

    A phase goes from rest to rest and is slowed as a whole, so its path and the shape of its
    speed are kept. Between waypoints joints go straight, and the tip, in an arc, a little farther.

    Args:
        arm: whose limits hold.
        waypoints: evenly spaced in time.
        reached: the arm's configurations at them.
        max_speed: of the tip, m/s.
    """
    even = float(waypoints.times[1] - waypoints.times[0]) if len(waypoints) > 1 else 0.0
    intervals = np.full(len(waypoints), even)
    farthest = _ways(arm, reached.joints)
    for rows in _phases(waypoints):
        if len(rows) < 2:
            continue
        speed, acceleration = _peaks(reached.joints[rows], even)
        intervals[rows[1:]] *= max(
            1.0,
            float(farthest[rows[:-1]].max()) / even / max_speed,
            _share(speed, arm.max_speed),
            np.sqrt(_share(acceleration, arm.max_acceleration)),
        )
    intervals[:1] = 0.0
    return JointTrajectory(arm, waypoints, reached, np.cumsum(intervals))


def _ways(arm: Arm, joints: NDArray) -> NDArray[np.float64]:
    """(N - 1,) metres: how far the tip would go from each of N configurations to the next at the
    pace of its fastest part."""
    part = np.linspace(0.0, 1.0, _PARTS + 1)[:-1, None]
    between = joints[:-1, None] + part * np.diff(joints, axis=0)[:, None]  # (N - 1, parts, n)
    tips = arm.tips(np.concatenate([between.reshape(-1, joints.shape[1]), joints[-1:]]))
    ways = np.linalg.norm(np.diff(tips, axis=0), axis=1).reshape(-1, _PARTS)
    return _PARTS * ways.max(axis=1)


def _phases(waypoints: Waypoints) -> list[NDArray[np.intp]]:
    """Rows of each phase, the last of the phase before it in front."""
    names = list(zip(waypoints.step.tolist(), waypoints.phases, strict=True))
    cuts = [0, *(i for i in range(1, len(names)) if names[i] != names[i - 1]), len(names)]
    return [np.arange(max(a - 1, 0), b) for a, b in zip(cuts, cuts[1:], strict=False)]


def _peaks(values: NDArray, interval: float) -> tuple[NDArray, NDArray]:
    """Speeds (m - 1, d) between m values, and accelerations (m, d) from rest to rest."""
    speed = np.diff(values, axis=0) / interval
    rest = np.zeros((1, values.shape[1]))
    return speed, np.diff(np.concatenate([rest, speed, rest]), axis=0) / interval


def _share(values: NDArray, limits: NDArray) -> float:
    return float((np.abs(values) / limits).max(initial=0.0))

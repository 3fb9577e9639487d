"""A plan as a timed trajectory of an arm, and its file: CSV, or the YAML of a ROS 2 message.

`joint` trajectories are trajectory_msgs/JointTrajectory, arm and gripper together; `cartesian` ones
are trajectory_msgs/MultiDOFJointTrajectory of the tip in the world frame. Neither needs ROS.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from knotflow.execution.arm.inverse_kinematics import IkSolution, follow_waypoints
from knotflow.execution.arm.model import Arm, ArmError, Base, find_arm
from knotflow.execution.arm.timing import keep_limits, rest_to_rest, samples
from knotflow.planning import GripperConfig, HandConfig, KnotPlan, Waypoints

FORMATS = ("csv", "ros2")
SPACES = ("joint", "cartesian")

MAX_LISTED = 12  # unreachable ranges of waypoints in a summary
LOWEST = 0.008  # of the tool point, metres: the Panda's fingers reach 7 mm beyond it


@dataclass(frozen=True, eq=False)
class Export:
    """A plan as N configurations of an arm in time, at rest between phases."""

    arm: Arm
    waypoints: Waypoints  # with their original times
    ik: IkSolution
    times: NDArray[np.float64]  # (N,) seconds, increasing
    slowdowns: NDArray[np.float64]  # (n,) of each drag's duration, to the simulated one
    format: str  # of its file, one of `FORMATS`
    space: str  # one of `SPACES`

    @property
    def text(self) -> str:
        """The file's contents."""
        return (_csv if self.format == "csv" else _ros2)(self)

    @property
    def slowed(self) -> float:
        """Largest slowdown of a drag, 1 or more."""
        return max(1.0, float(self.slowdowns.max()))

    def first_unreached(self, most_slowed: float = np.inf) -> int | None:
        """The first step with a waypoint out of reach, or slowed by more; None without any."""
        bad = {*self.waypoints.step[~self.ik.ok], *np.flatnonzero(self.slowdowns > most_slowed)}
        return int(min(bad)) if bad else None

    @property
    def reachable(self) -> bool:
        """Whether the arm reaches every waypoint."""
        return bool(self.ik.ok.all())

    def peaks(self) -> dict[str, float]:
        """Peak tip speed (m/s) and acceleration (m/s^2), and joints' as shares of their limits."""
        names = "tip_speed", "tip_acceleration", "joint_speed", "joint_acceleration"
        peaks = dict.fromkeys(names, 0.0)
        for rows in _phases(self.waypoints):
            if len(rows) < 2:
                continue
            curve = rest_to_rest(self.times[rows], self.ik.joints[rows])
            at = samples(curve)
            velocity, acceleration = _tip_motion(self.arm, curve)
            of_phase = (
                np.linalg.norm(velocity, axis=1).max(),
                np.linalg.norm(acceleration, axis=1).max(),
                (np.abs(curve(at, 1)) / self.arm.max_speed).max(),
                (np.abs(curve(at, 2)) / self.arm.max_acceleration).max(),
            )
            peaks = {
                name: max(peaks[name], float(peak))
                for name, peak in zip(names, of_phase, strict=True)
            }
        return peaks

    def rates(self, values: NDArray) -> NDArray[np.float64]:
        """(N, d) velocities of values (N, d), a second, along cubics from rest to rest in each
        phase."""
        rates = np.zeros_like(values)
        for rows in _phases(self.waypoints):
            inner = rows[1:-1]
            if len(inner):
                rates[inner] = rest_to_rest(self.times[rows], values[rows])(self.times[inner], 1)
        return rates

    def summary(self) -> str:
        """Duration, peaks, and what cannot be reached, for printing."""
        ik, waypoints, peaks = self.ik, self.waypoints, self.peaks()
        lines = [
            f"{self.arm.name}: {len(self.times)} waypoints, {self.times[-1]:.1f} s; the rope moves "
            f"{self.slowed:.1f} times slower than simulated",
            f"peak at the tip {peaks['tip_speed']:.3f} m/s and "
            f"{peaks['tip_acceleration']:.2f} m/s^2; in the joints {peaks['joint_speed']:.0%} of "
            f"the speed limit, {peaks['joint_acceleration']:.0%} of the acceleration limit",
        ]
        if self.reachable:
            lines.append(
                f"all waypoints reached: at most {ik.error.max() * 1e3:.2f} mm off, gripper "
                f"tilted by at most {np.rad2deg(ik.tilt.max()):.0f} degrees"
            )
            return "\n".join(lines)
        missed = ~ik.ok
        lines.append(f"{missed.sum()} waypoints cannot be reached; do not execute this trajectory:")
        ranges = _runs(missed)
        for rows in ranges[:MAX_LISTED]:
            worst = rows[int(ik.error[rows].argmax())]
            position = ", ".join(f"{number:.3f}" for number in waypoints.positions[worst])
            lines.append(
                f"  {rows[0]} to {rows[-1]} ({waypoints.actions[worst]}, "
                f"{waypoints.phases[worst]}): up to {ik.error[worst] * 1e3:.1f} mm off at "
                f"({position}) m, tilt {np.rad2deg(ik.tilt[rows].max()):.0f} and turn "
                f"{np.rad2deg(ik.turn[rows].max()):.0f} degrees"
            )
        if len(ranges) > MAX_LISTED:
            lines.append(f"  and {len(ranges) - MAX_LISTED} more ranges")
        return "\n".join(lines)


def _time_joints(
    arm: Arm, waypoints: Waypoints, ik: IkSolution, max_speed: float
) -> NDArray[np.float64]:
    """Times (N,) of evenly spaced waypoints, each phase from rest to rest: slowed as a whole until
    the tip (m/s), and where they are too fast until the joints keep their limits."""
    even = float(waypoints.times[1] - waypoints.times[0]) if len(waypoints) > 1 else 0.0
    times = np.zeros(len(waypoints))
    for rows in _phases(waypoints):
        if len(rows) < 2:
            continue
        curve = keep_limits(arm, ik.joints[rows], np.full(len(rows) - 1, even))
        speeds = np.linalg.norm(_tip_motion(arm, curve)[0], axis=1)
        times[rows] = times[rows[0]] + curve.x * max(1.0, float(speeds.max()) / max_speed)
    return times


def _tip_motion(arm: Arm, curve: CubicSpline) -> tuple[NDArray, NDArray]:
    """Velocities (M, 3), m/s, and accelerations (M + 1, 3) of the tip along joints in time, from
    rest to rest."""
    at = samples(curve)
    step = np.diff(at)[:, None]
    velocity = np.diff(arm.tip_positions(curve(at)), axis=0) / step
    rest = np.zeros((1, 3))
    between = np.pad((step[1:] + step[:-1]) / 2, ((1, 1), (0, 0)), "edge")
    return velocity, np.diff(np.concatenate([rest, velocity, rest]), axis=0) / between


def _phases(waypoints: Waypoints) -> list[NDArray[np.intp]]:
    """Rows of each phase, the last of the phase before it in front."""
    names = list(zip(waypoints.step.tolist(), waypoints.phases, strict=True))
    cuts = [0, *(i for i in range(1, len(names)) if names[i] != names[i - 1]), len(names)]
    return [np.arange(max(a - 1, 0), b) for a, b in itertools.pairwise(cuts)]


def export_plan(
    plan: KnotPlan,
    arm: str | Path | Arm = "panda",
    base: Path | Base | None = None,
    max_speed: float = 0.25,
    format: str = "csv",
    space: str = "joint",
    rate_hz: float = 20.0,
    tip: str | None = None,
) -> Export:
    """A plan's motion by an arm, from above the first grasp on.

    Args:
        plan: with at least one step.
        arm: name in `ARMS`, an MJCF or URDF file, or an `Arm`.
        base: its pose in the frame in which the rope was measured, or a YAML file, see `Base.load`;
            by default the arm's own, from the table.
        max_speed: of the tip, m/s.
        format: csv or ros2.
        space: joint or cartesian.
        rate_hz: waypoints per second, before they are slowed.
        tip: of an arm's file, see `load_arm`.

    Raises:
        ArmError: an arm, base, speed, format or space that cannot be used, or nothing to execute.
        ValueError: a rate that is not above 0, or a rope too high to pass above.
    """
    for name, value, known in (("format", format, FORMATS), ("space", space, SPACES)):
        if value not in known:
            raise ArmError(f"unknown {name} {value!r}; choose {' or '.join(known)}")
    if not 0.0 < max_speed < np.inf:
        raise ArmError(f"max_speed must be above 0 m/s, got {max_speed}")
    if not plan.steps:
        raise ArmError(f"the plan for {plan.goal} has no steps to execute: {plan.reason}")
    arm = find_arm(arm, tip)
    base = Base.load(base) if isinstance(base, str | Path) else base
    moves = GripperConfig(
        travel_speed=max_speed,
        vertical_speed=min(GripperConfig().vertical_speed, max_speed),
        drag_speed=max_speed,
        lowest=LOWEST,
    ).clear_of(plan.shapes, plan.radius)
    waypoints, frame = plan.waypoints(rate_hz, moves), replace(plan.frame, unit="m")
    ik = follow_waypoints(waypoints, arm, base.seen_from(frame) if base else None)
    waypoints = replace(waypoints, positions=frame.to_file(waypoints.positions))
    positions, quaternions = frame.to_file(ik.positions), frame.turned(ik.quaternions)
    ik = replace(ik, positions=positions, quaternions=quaternions)
    times = _time_joints(arm, waypoints, ik, max_speed)
    dragging = np.array(waypoints.phases) == "drag"
    intervals = np.diff(times, prepend=0.0)[dragging]
    seconds = np.bincount(waypoints.step[dragging], intervals, len(plan.steps))
    slowdowns = seconds / [step.release_time for step in plan.steps]
    return Export(arm, waypoints, ik, times, slowdowns, format, space)


def _runs(mask: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Rows of each stretch in which the mask (N,) is true."""
    rows = np.flatnonzero(mask)
    return [run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(run)]


def _gripper_positions(export: Export) -> NDArray[np.float64]:
    """Positions (N,) of the gripper's joint, which closes and lets go while the arm stands."""
    opened, closed = export.arm.opening
    return closed + (opened - closed) * export.waypoints.openings / HandConfig().opening


def _csv(export: Export) -> str:
    waypoints, ik = export.waypoints, export.ik
    if export.space == "joint":
        names, values = [*export.arm.joints], ik.joints
    else:
        names = ["x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]
        values = np.concatenate([ik.positions, ik.quaternions], axis=1)
    table = pd.DataFrame(values, columns=names)
    table.insert(0, "time_s", export.times)
    table[export.arm.gripper] = _gripper_positions(export)
    table["closed"], table["reached"] = waypoints.closed.astype(int), ik.ok.astype(int)
    table["step"], table["action"] = waypoints.step, waypoints.actions
    table["phase"] = waypoints.phases
    return table.to_csv(index=False, float_format="%.6f", lineterminator="\n")


def _ros2(export: Export) -> str:
    arm, ik, times = export.arm, export.ik, export.times
    points: list[dict[str, Any]] = []
    if export.space == "joint":
        kind, names, frame = "JointTrajectory", [*arm.joints, arm.gripper], ""
        gripper = _gripper_positions(export)
        positions = np.column_stack([ik.joints, gripper])
        speeds = np.column_stack([export.rates(ik.joints), np.gradient(gripper, times)])
        points = [
            {"positions": position, "velocities": speed}
            for position, speed in zip(_rounded(positions), _rounded(speeds), strict=True)
        ]
    else:
        kind, names, frame = "MultiDOFJointTrajectory", [arm.tip], "world"
        columns = map(_rounded, (ik.positions, ik.quaternions, export.rates(ik.positions)))
        for position, (w, x, y, z), speed in zip(*columns, strict=True):
            turn = {"x": x, "y": y, "z": z, "w": w}
            pose = {"translation": dict(zip("xyz", position, strict=True)), "rotation": turn}
            velocity = {"linear": dict(zip("xyz", speed, strict=True))}
            points.append({"transforms": [pose], "velocities": [velocity]})
    for point, time in zip(points, times, strict=True):
        seconds, nanoseconds = divmod(round(float(time) * 1e9), 10**9)
        point["time_from_start"] = {"sec": seconds, "nanosec": nanoseconds}
    # For arms whose gripper is commanded apart:
    phases = np.array(export.waypoints.phases)
    events = sorted(
        (times[rows[0]], phase) for phase in ("close", "open") for rows in _runs(phases == phase)
    )
    comments = "".join(f"# {time:9.3f} s: {phase} the gripper\n" for time, phase in events)
    header = {"header": {"frame_id": frame}, "joint_names": names}
    head = yaml.safe_dump(header, sort_keys=False, default_flow_style=None, width=1000)
    line: dict[str, Any] = {"sort_keys": False, "default_flow_style": True, "width": 10**6}
    body = "".join(f"- {yaml.safe_dump(point, **line)}" for point in points)
    return f"# trajectory_msgs/msg/{kind}\n{comments}{head}points:\n{body}"


def _rounded(values: NDArray) -> Any:
    return np.round(values, 6).tolist()

"""A plan as a trajectory file for an arm: CSV, or the YAML of a ROS 2 message.

`joint` trajectories are trajectory_msgs/JointTrajectory, arm and gripper together; `cartesian` ones
are trajectory_msgs/MultiDOFJointTrajectory of the tip in the world frame. Neither needs ROS.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from knotflow.execution.arm import Arm, ArmError, Base, load_arm
from knotflow.execution.franka import panda
from knotflow.execution.reach import follow_waypoints
from knotflow.execution.timing import JointTrajectory, time_joints
from knotflow.planning import GripperConfig, KnotPlan

ARMS: dict[str, Callable[[], Arm]] = {"panda": panda}
"""Arms known by name."""

FORMATS = ("csv", "ros2")
SPACES = ("joint", "cartesian")

_SHOWN = 12  # ranges of waypoints named before the rest is counted


@dataclass(frozen=True, eq=False)
class Export:
    """What `export_plan` returns.

    Attributes:
        text: the file's contents.
        trajectory: what they were made of.
        slowed: how many times longer than simulated the gripper holds the rope, 1 or more.
    """

    text: str
    trajectory: JointTrajectory
    slowed: float

    @property
    def reachable(self) -> bool:
        """Whether the arm reaches every waypoint."""
        return len(self.trajectory.unreachable) == 0

    def summary(self) -> str:
        """Duration, peaks, and what cannot be reached, for printing."""
        trajectory, reached = self.trajectory, self.trajectory.reached
        peaks, missed = trajectory.peaks(), trajectory.unreachable
        lines = [
            f"{trajectory.arm.name}: {len(trajectory.times)} waypoints, "
            f"{trajectory.times[-1]:.1f} s; the rope moves {self.slowed:.1f} times slower than "
            "simulated",
            f"peak at the tip {peaks['tip_speed']:.3f} m/s and "
            f"{peaks['tip_acceleration']:.2f} m/s^2; in the joints {peaks['joint_speed']:.0%} of "
            f"the speed limit, {peaks['joint_acceleration']:.0%} of the acceleration limit",
        ]
        if not len(missed):
            lines.append(
                f"all waypoints reached: at most {reached.error.max() * 1e3:.2f} mm off, gripper "
                f"tilted by at most {np.rad2deg(reached.tilt.max()):.0f} degrees"
            )
            return "\n".join(lines)
        lines.append(f"{len(missed)} waypoints cannot be reached; do not execute this trajectory:")
        ranges = np.split(missed, np.flatnonzero(np.diff(missed) > 1) + 1)
        waypoints = trajectory.waypoints
        for rows in ranges[:_SHOWN]:
            worst = rows[int(reached.error[rows].argmax())]
            place = ", ".join(f"{number:.3f}" for number in waypoints.positions[worst])
            lines.append(
                f"  {rows[0]} to {rows[-1]} ({waypoints.actions[worst]}, "
                f"{waypoints.phases[worst]}): up to {reached.error[worst] * 1e3:.1f} mm off at "
                f"({place}) m, tilt {np.rad2deg(reached.tilt[rows].max()):.0f} and turn "
                f"{np.rad2deg(reached.turn[rows].max()):.0f} degrees"
            )
        if len(ranges) > _SHOWN:
            lines.append(f"  and {len(ranges) - _SHOWN} more ranges")
        return "\n".join(lines)


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
    """A plan's motion by an arm, moves between the splines included.

    It begins above the first grasp, where the arm must be brought first.

    Args:
        plan: with at least one step.
        arm: `panda`, an MJCF file, or an `Arm`.
        base: where it stands, or a YAML file that says so, see `Base.load`; by default the arm's.
        max_speed: of the tip, m/s.
        format: csv or ros2.
        space: joint or cartesian.
        rate_hz: waypoints per second, before joint limits slow them.
        tip: for an MJCF file, the site between the fingers, see `load_arm`.

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
    if not isinstance(arm, Arm):
        arm = ARMS[str(arm)]() if str(arm) in ARMS else load_arm(Path(arm), tip)
    base = Base.load(base) if isinstance(base, str | Path) else base
    default = GripperConfig()
    moves = GripperConfig(
        travel_speed=max_speed,
        vertical_speed=min(default.vertical_speed, max_speed),
        drag_speed=max_speed,
    )
    waypoints = plan.waypoints(rate_hz, moves)
    reached = follow_waypoints(plan, waypoints, arm, base)
    trajectory = time_joints(arm, waypoints, reached, max_speed)
    write = {"csv": _csv, "ros2": _ros2}[format]
    return Export(write(trajectory, space), trajectory, _slowed(trajectory, plan.move_time))


def _slowed(trajectory: JointTrajectory, move_time: float) -> float:
    spent = np.diff(trajectory.times, prepend=0.0)[np.array(trajectory.waypoints.phases) == "drag"]
    return max(1.0, float(spent.sum()) / (move_time * (trajectory.waypoints.step[-1] + 1)))


def _opening(trajectory: JointTrajectory) -> NDArray[np.float64]:
    """Position (N,) of the gripper's joint: it moves while the arm stands."""
    wide, narrow = trajectory.arm.opening
    phases = np.array(trajectory.waypoints.phases)
    closed = trajectory.waypoints.closed.astype(float)
    for phase in ("close", "open"):
        for rows in _runs(phases == phase):
            u = np.arange(1, len(rows) + 1) / len(rows)
            closed[rows] = u if phase == "close" else 1.0 - u
    return wide + (narrow - wide) * closed


def _runs(mask: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    rows = np.flatnonzero(mask)
    return [run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(run)]


def _csv(trajectory: JointTrajectory, space: str) -> str:
    waypoints, reached = trajectory.waypoints, trajectory.reached
    names: Iterable[str]
    if space == "joint":
        names, values = trajectory.arm.joints, reached.joints
    else:
        names = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
        values = np.concatenate([reached.positions, reached.quaternions], axis=1)
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    ending = ("closed", "reached", "step", "action", "phase")
    writer.writerow(("time_s", *names, trajectory.arm.gripper, *ending))
    opening = _opening(trajectory)
    for i, time in enumerate(trajectory.times):
        numbers = (f"{number:.6f}" for number in (time, *values[i], opening[i]))
        flags = int(waypoints.closed[i]), int(reached.ok[i])
        where = (waypoints.step[i], waypoints.actions[i], waypoints.phases[i])
        writer.writerow((*numbers, *flags, *where))
    return file.getvalue()


def _ros2(trajectory: JointTrajectory, space: str) -> str:
    arm, reached = trajectory.arm, trajectory.reached
    opening = _opening(trajectory)
    points: list[dict[str, Any]] = []
    if space == "joint":
        kind, names, frame = "JointTrajectory", [*arm.joints, arm.gripper], ""
        positions = np.column_stack([reached.joints, opening])
        speeds = np.column_stack([trajectory.joint_speeds, np.gradient(opening, trajectory.times)])
        for position, speed in zip(positions, speeds, strict=True):
            points.append({"positions": _listed(position), "velocities": _listed(speed)})
    else:
        kind, names, frame = "MultiDOFJointTrajectory", [arm.tip], "world"
        for place, (w, x, y, z), speed in zip(
            reached.positions, reached.quaternions, trajectory.tip_speeds, strict=True
        ):
            rotation = dict(zip("xyzw", _listed(np.array([x, y, z, w])), strict=True))
            transform = {"translation": _vector(place), "rotation": rotation}
            points.append({"transforms": [transform], "velocities": [{"linear": _vector(speed)}]})
    for point, time in zip(points, trajectory.times, strict=True):
        nanoseconds = round(float(time) * 1e9)
        stamp = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
        point["time_from_start"] = stamp
    message = {"header": {"frame_id": frame}, "joint_names": names, "points": points}
    return f"# trajectory_msgs/msg/{kind}\n" + _gripper_comments(trajectory) + _yaml(message)


def _gripper_comments(trajectory: JointTrajectory) -> str:
    """When the gripper closes and opens, for arms whose gripper is commanded apart."""
    lines = []
    phases = np.array(trajectory.waypoints.phases)
    for phase in ("close", "open"):
        lines += [(trajectory.times[rows[0]], phase) for rows in _runs(phases == phase)]
    return "".join(f"# {time:9.3f} s: {phase} the gripper\n" for time, phase in sorted(lines))


def _yaml(message: dict[str, Any]) -> str:
    """The message, a line for each point: block style would take ten times the lines."""
    points = message.pop("points")
    head = yaml.safe_dump(message, sort_keys=False, default_flow_style=None, width=1000)
    flow = (
        yaml.safe_dump(one, sort_keys=False, default_flow_style=True, width=10**6) for one in points
    )
    return head + "points:\n" + "".join(f"- {line}" for line in flow)


def _listed(values: NDArray) -> list[float]:
    return [round(float(value), 6) for value in values]


def _vector(values: NDArray) -> dict[str, float]:
    return dict(zip("xyz", _listed(values), strict=True))

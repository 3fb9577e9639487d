"""A driver for an arm, a gripper and an RGB-D camera under ROS 2 Jazzy or later.

It was tested against stubs of rclpy and its messages, not on hardware. Both come with ROS 2 and are
imported when a `Ros2Arm` is created.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from knotflow.execution.arm.export import LOWEST
from knotflow.execution.arm.inverse_kinematics import Solver
from knotflow.execution.arm.model import Arm, Base, find_arm
from knotflow.execution.arm.timing import keep_limits
from knotflow.perception import RgbdImage
from knotflow.perception.camera.ros_image import read_messages, stamp
from knotflow.topology.polyline import Floats

STILL = 1e-4  # metres that are no motion
LEAST_POINTS = 10  # of a trajectory, so that it keeps to its line
MAX_TURN_STEP = 0.1  # radians between points
MAX_STATE_AGE = 0.1  # seconds
MAX_SKEW = 0.02  # seconds between colour and depth of one image
POLL = 0.02  # seconds for which messages are waited for at a time


class Ros2Error(OSError):
    """A server or topic that is missing, or a goal that failed."""


@dataclass(frozen=True)
class Ros2Config:
    """A lab's arm, gripper and camera, and their names in ROS."""

    arm: str | Path | Arm = "panda"
    """See `find_arm`."""
    tip: str | None = None
    """See `load_arm`."""
    base: Base | None = None
    """By default the arm's own."""
    joints: tuple[str, ...] = ()
    """Names in ROS, from the base on; by default those of the arm's model."""
    trajectory_action: str = "/joint_trajectory_controller/follow_joint_trajectory"
    gripper_action: str = "/gripper_controller/gripper_cmd"
    joint_states: str = "/joint_states"
    colour: str = "/camera/camera/color/image_raw"
    depth: str = "/camera/camera/aligned_depth_to_color/image_raw"
    """At the colour image's pixels."""
    camera_info: str = "/camera/camera/color/camera_info"
    rectified: bool = False
    """Whether the images are free of the distortion in `camera_info`. Those of image_proc have the
    focal lengths and centre of its `p`: give the camera these."""
    opened: float = 0.04
    """Gripper position, in its controller's unit, a gap, a finger's way or an angle, when the
    fingers are"""
    widest: float = 0.05
    """so far apart, metres, and"""
    closed: float = 0.0
    """when they touch; it may stall before, on the rope."""
    max_effort: float = 10.0
    timeout: float = 5.0
    """Seconds for which servers, joint states, and results that are due are waited for."""
    image_timeout: float = 2.0
    """Seconds for which a new image is waited for, and largest age of one."""
    ros_args: tuple[str, ...] = ()
    """As of a node's command line, such as ("--ros-args", "-p", "use_sim_time:=true")."""


class _Motion(NamedTuple):
    """A trajectory under way."""

    handle: Any
    result: Any  # the future
    ahead: list[tuple[Floats, float]]  # positions (3,), metres, and when they are reached, ROS time


class Ros2Arm:
    """A `Robot` by FollowJointTrajectory, GripperCommand and image topics, see `Ros2Config`.

    Announced moves become one trajectory, others one each, from rest to rest within the arm's speed
    and acceleration limits, so they may take longer. A motion too near the table is raised as a
    whole, which `position` leaves out. The gripper has to point down when the driver is created,
    which opens it.

    Raises:
        ImportError: this Python has no ROS 2.
        Ros2Error: a server is missing.
        ArmError: an arm that cannot be used.
    """

    def __init__(self, config: Ros2Config | None = None) -> None:
        try:
            import rclpy
            from action_msgs.msg import GoalStatus
            from control_msgs.action import FollowJointTrajectory, GripperCommand
            from message_filters import ApproximateTimeSynchronizer, Subscriber
            from rclpy.action import ActionClient
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.qos import qos_profile_sensor_data as qos
            from rclpy.signals import SignalHandlerOptions
            from sensor_msgs.msg import CameraInfo, Image, JointState
        except ImportError as error:
            raise ImportError(
                f"Ros2Arm needs rclpy, control_msgs and message_filters of ROS 2 ({error}): source "
                "its setup.bash, and run knotflow in the Python that ROS 2 was built for"
            ) from error
        self.config = config = config or Ros2Config()
        self._arm = find_arm(config.arm, config.tip)
        self._solver = Solver(self._arm, config.base or self._arm.base)
        self._names = config.joints or self._arm.joints
        self._joints, self._joints_time = np.empty(0), -np.inf
        self._frame: tuple[Any, Any, Any] | None = None
        self._expected: tuple[Floats, float, float | None] | None = None
        self._motion: _Motion | None = None
        self._ended = -np.inf  # ROS time at the end of the last motion
        self._lift = np.zeros(3)  # metres by which the last motion is raised to clear the table
        self._open = False  # as far as it is known
        self._opened = config.opened  # the gripper's position where it opens
        self._endings = {
            GoalStatus.STATUS_SUCCEEDED: "",
            GoalStatus.STATUS_ABORTED: "aborted",
            GoalStatus.STATUS_CANCELED: "cancelled",
        }
        if not rclpy.ok():
            # Ctrl-C raises KeyboardInterrupt, and ROS stays up to cancel and to open the fingers.
            rclpy.init(args=list(config.ros_args), signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("knotflow")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(JointState, config.joint_states, self._on_joints, qos)
        topics = (Image, config.colour), (Image, config.depth), (CameraInfo, config.camera_info)
        parts = [Subscriber(self._node, *topic, qos_profile=qos) for topic in topics]
        self._images = ApproximateTimeSynchronizer(parts, 10, MAX_SKEW)
        self._images.registerCallback(self._on_frame)
        self._mover = ActionClient(self._node, FollowJointTrajectory, config.trajectory_action)
        self._gripper = ActionClient(self._node, GripperCommand, config.gripper_action)
        actions = (config.trajectory_action, self._mover), (config.gripper_action, self._gripper)
        for name, client in actions:
            if not client.wait_for_server(timeout_sec=config.timeout):
                raise Ros2Error(f"no action server {name}: is its controller active?")
        self.release()

    def observe(self) -> RgbdImage:
        """The newest image, taken after the last motion.

        Raises:
            TimeoutError: no image came.
            Ros2Error: images came, all of them older.
        """
        self._stop()
        config, before = self.config, self._frame
        since = max(self._ended, self._now() - config.image_timeout)
        if not self._spin(lambda: self._frame_time() > since, config.image_timeout):
            if self._frame is before:
                raise TimeoutError(f"no images on {config.colour} and {config.depth}")
            raise Ros2Error(
                f"images are {since - self._frame_time():.2f} s older than the last motion: are "
                "the clocks of camera and controller synchronised?"
            )
        assert self._frame is not None
        return read_messages(*self._frame, rectified=config.rectified)

    def expect(self, positions: NDArray, seconds: float, strand: float | None = None) -> bool:
        self._expected = np.array(positions, np.float64), seconds, strand
        return True

    def move_to(self, position: NDArray, seconds: float) -> None:
        if self._motion is not None and not np.allclose(self._motion.ahead[0][0], position):
            self._stop()
        motion, self._motion = self._motion or self._begin(position, seconds), None
        if motion is None:
            self._spin(lambda: False, seconds)
            return
        _, arrival = motion.ahead.pop(0)
        try:
            self._spin(lambda: self._now() >= arrival or motion.result.done())
            if motion.result.done() or not motion.ahead:
                name = self.config.trajectory_action
                result, failure = self._outcome(name, motion.result)
                if failure:
                    code, reason = result.error_code, result.error_string
                    raise Ros2Error(f"{name}: {failure}, error {code} {reason}")
        except BaseException:
            motion.handle.cancel_goal_async()
            raise
        self._motion = motion if motion.ahead else None
        self._ended = self._now()

    def grasp(self) -> None:
        self._open = False
        self._grip(self.config.closed, may_stall=True)

    def release(self) -> None:
        self._stop()
        if not self._open:
            self._grip(self._opened)
            self._open = True

    def open_to(self, opening: float) -> None:
        config, before = self.config, self._opened
        share = min(opening / config.widest, 1.0)
        self._opened = config.closed + share * (config.opened - config.closed)
        if self._open and self._opened != before:
            self._grip(self._opened)

    @property
    def position(self) -> Floats:
        return self._solver.tip(self._measured()) - self._lift

    def _begin(self, position: NDArray, seconds: float) -> _Motion | None:
        """Start the expected moves if this is their first, else one; None if there is no way."""
        expected, self._expected = self._expected, None
        if expected is None or not np.allclose(expected[0][0], position):
            expected = np.array(position, np.float64)[None], seconds, None
        positions, seconds, strand = expected
        self._lift = np.array([0.0, 0.0, max(LOWEST - float(positions[:, 2].min()), 0.0)])
        lifted, start = positions + self._lift, self._measured()
        if np.abs(lifted - self._solver.tip(start)).max() < STILL:
            return None
        joints, parts = self._plan(start, lifted, strand)
        moved = keep_limits(self._arm, joints, np.full(len(joints) - 1, seconds / parts))
        times, rates = moved.x, moved(moved.x, 1)
        rates[[0, -1]] = 0.0  # controllers reject a rounding error
        goal = self._trajectory(joints, times, rates)
        handle, result = self._request(self.config.trajectory_action, self._mover, goal)
        arrivals = self._now() + times[parts::parts]
        return _Motion(handle, result, list(zip(positions, arrivals.tolist(), strict=True)))

    def _plan(self, start: Floats, positions: Floats, strand: float | None) -> tuple[Floats, int]:
        """Joints (N * parts + 1, J) at even times through positions (N, 3), and `parts` of each."""
        solver, count = self._solver, len(positions)
        yaw = solver.yaw(start, 0.0)
        turn = 0.0 if strand is None else (strand - yaw + np.pi / 2) % np.pi - np.pi / 2
        knots = np.vstack([solver.tip(start), positions])
        curve = CubicSpline(np.arange(count + 1), knots, bc_type="clamped")
        turns = [turn] if strand is None else [turn, turn - np.copysign(np.pi, turn)]
        for turn in turns:  # two grasps, half a turn apart
            # The smooth step is at most 1.5 times as fast as its mean.
            least = max(LEAST_POINTS, 1.5 * abs(turn) / MAX_TURN_STEP)
            parts = int(np.ceil(least / count))
            u = np.linspace(0.0, 1.0, count * parts + 1)[1:]
            yaws = yaw + u**2 * (3.0 - 2.0 * u) * turn
            aligned = np.full(len(u), strand is not None)
            path = solver.follow(start, curve(u * count), yaws, aligned)
            if not path.missed:
                return np.vstack([start, path.joints]), parts
        raise Ros2Error(
            f"{self._arm.name} cannot move in a line from {knots[0].round(3).tolist()} to "
            f"{knots[-1].round(3).tolist()} m with its gripper down: {path.missed} of {len(u)} "
            "points are out of reach"
        )

    def _trajectory(self, joints: Floats, times: Floats, rates: Floats) -> Any:
        from control_msgs.action import FollowJointTrajectory
        from rclpy.duration import Duration
        from trajectory_msgs.msg import JointTrajectoryPoint

        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = list(self._names)
        goal.trajectory.points = [
            JointTrajectoryPoint(
                positions=place.tolist(),
                velocities=rate.tolist(),
                time_from_start=Duration(seconds=time).to_msg(),
            )
            for place, rate, time in zip(joints, rates, times.tolist(), strict=True)
        ]
        return goal

    def _grip(self, position: float, may_stall: bool = False) -> None:
        from control_msgs.action import GripperCommand

        self._stop()
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = position, self.config.max_effort
        name = self.config.gripper_action
        result, failure = self._outcome(name, self._request(name, self._gripper, goal)[1])
        if failure and not (may_stall and result.stalled):
            raise Ros2Error(f"{name}: {failure} at {result.position:g}, on the way to {position:g}")

    def _request(self, name: str, client: Any, goal: Any) -> tuple[Any, Any]:
        """Handle and future result of an accepted goal."""
        sent = client.send_goal_async(goal)
        try:
            if not self._spin(sent.done, self.config.timeout):
                raise Ros2Error(f"{name}: no answer for {self.config.timeout:g} s")
        except BaseException:
            sent.add_done_callback(lambda late: late.result().cancel_goal_async())
            raise
        handle = sent.result()
        if not handle.accepted:
            raise Ros2Error(f"{name}: the goal was rejected")
        return handle, handle.get_result_async()

    def _outcome(self, name: str, result: Any) -> tuple[Any, str]:
        """The result of a goal that is due, and how it failed, if it did."""
        if not self._spin(result.done, self.config.timeout):
            raise Ros2Error(f"{name}: no result {self.config.timeout:g} s after it was due")
        response = result.result()
        return response.result, self._endings.get(response.status, f"status {response.status}")

    def _stop(self) -> None:
        """Cancel what is left of an announced motion."""
        motion, self._motion, self._expected = self._motion, None, None
        if motion is not None:
            motion.handle.cancel_goal_async()
            self._spin(motion.result.done, self.config.timeout)
            self._ended = self._now()

    def _spin(self, done: Callable[[], bool], seconds: float = np.inf) -> bool:
        """Handle messages until it is done, or for so long."""
        end = self._now() + seconds
        while not done():
            left = end - self._now()
            if left <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(left, POLL))
        return True

    def _now(self) -> float:
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def _measured(self) -> Floats:
        """Joints (J,) after the last motion."""
        since = max(self._ended, self._now() - MAX_STATE_AGE)
        if not self._spin(lambda: self._joints_time >= since, self.config.timeout):
            raise Ros2Error(
                f"no new state of {', '.join(self._names)} on {self.config.joint_states}"
            )
        return self._joints

    def _on_joints(self, message: Any) -> None:
        measured = dict(zip(message.name, message.position, strict=False))  # some have none
        if measured.keys() >= set(self._names):  # else it is of the gripper alone
            self._joints = np.array([measured[name] for name in self._names])
            self._joints_time = stamp(message)

    def _on_frame(self, colour: Any, depth: Any, info: Any) -> None:
        self._frame = colour, depth, info

    def _frame_time(self) -> float:
        return min(map(stamp, self._frame[:2])) if self._frame else -np.inf

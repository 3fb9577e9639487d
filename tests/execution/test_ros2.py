"""The ROS 2 driver against a stub of rclpy and the messages, in simulated time: fields, futures and
goals as rclpy's, and an arm that follows cubic splines, as joint_trajectory_controller does."""

import sys
from dataclasses import field, make_dataclass, replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from knotflow.apps import lab
from knotflow.execution import ExecutionConfig, TrueState, Twin, TwinConfig, execute, load_arm, ur5e
from knotflow.execution.arm.export import LOWEST
from knotflow.execution.arm.inverse_kinematics import Solver
from knotflow.execution.ros2 import Ros2Arm, Ros2Config, Ros2Error
from knotflow.perception import Camera
from knotflow.recording import RunLog
from knotflow.simulation import RopeConfig, straight

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
STEP = 0.01  # seconds of simulated time, the period of joint states
IMAGE_PERIOD = 0.05


def message(name, /, **defaults):
    """A class with these fields alone, as rosidl makes them."""
    fields = [
        (
            one,
            object,
            field(default_factory=value if callable(value) else lambda value=value: value),
        )
        for one, value in defaults.items()
    ]
    return make_dataclass(name, fields, slots=True, kw_only=True)


Stamp = message("Duration", sec=0, nanosec=0)
Header = message("Header", stamp=Stamp, frame_id="")
Point = message(
    "JointTrajectoryPoint",
    positions=list, velocities=list, accelerations=list, effort=list, time_from_start=Stamp,
)  # fmt: skip
Trajectory = message("JointTrajectory", header=Header, joint_names=list, points=list)
FollowJointTrajectory = SimpleNamespace(
    Goal=message("Goal", trajectory=Trajectory),
    Result=message("Result", error_code=0, error_string=""),
)
Command = message("GripperCommand", position=0.0, max_effort=0.0)
GripperCommand = SimpleNamespace(
    Goal=message("Goal", command=Command),
    Result=message("Result", position=0.0, effort=0.0, stalled=False, reached_goal=False),
)
JointState = message(
    "JointState", header=Header, name=list, position=list, velocity=list, effort=list
)
Image = message(
    "Image", header=Header, height=0, width=0, encoding="", is_bigendian=0, step=0, data=bytes
)
CameraInfo = message(
    "CameraInfo", header=Header, height=0, width=0, distortion_model="plumb_bob", d=list, k=list,
    r=list, p=list,
)  # fmt: skip


def stamped(seconds):
    whole, rest = divmod(round(seconds * 1e9), 10**9)
    return Stamp(sec=whole, nanosec=rest)


def seconds_of(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


class Future:
    def __init__(self):
        self._result, self._callbacks = None, []

    def done(self):
        return self._result is not None

    def result(self):
        return self._result

    def set_result(self, result):
        self._result = result
        for callback in self._callbacks:
            callback(self)

    def add_done_callback(self, callback):
        callback(self) if self.done() else self._callbacks.append(callback)


class Handle:
    """ClientGoalHandle and what its server knows."""

    def __init__(self, goal, accepted, began):
        self.goal, self.accepted, self.began = goal, accepted, began
        self.future, self.cancelled = Future(), False

    def get_result_async(self):
        return self.future

    def cancel_goal_async(self):
        self.cancelled = True

    def end(self, status, result):
        self.future.set_result(SimpleNamespace(status=status, result=result))


class Ros:
    """Its clock, an arm's and a gripper's action servers, joint states and a camera."""

    def __init__(self, names, joints):
        self.time, self.names, self.joints = 1000.0, names, np.array(joints, float)
        self.mode = ""  # what fails
        self.subscriptions, self.pending, self.goals, self.grips = {}, [], [], []
        self.images = [Image(), Image(), CameraInfo()]
        self.camera_delay = 0.0  # of its clock
        self.stalls, self.inits = False, []

    def step(self, seconds):
        self.time += seconds
        for future, handle in self.pending:
            future.set_result(handle)
        self.pending = []
        if self.goals and not self.goals[-1].future.done():
            self.follow(self.goals[-1])
        header = Header(stamp=stamped(self.time))
        if self.mode != "no joints":
            states = [(["finger"], [0.0]), (self.names[::-1], self.joints[::-1].tolist())]
            for name, position in states:
                state = JointState(header=header, name=name, position=position)
                self.subscriptions["/joint_states"](state)
        if self.mode != "no images" and self.time % IMAGE_PERIOD < seconds:
            for topic, image in zip(self.topics, self.images, strict=True):
                image.header = Header(stamp=stamped(self.time - self.camera_delay))
                self.subscriptions[topic](image)

    topics = Ros2Config.colour, Ros2Config.depth, Ros2Config.camera_info

    def send(self, goal):
        future = Future()
        if isinstance(goal, GripperCommand.Goal):
            handle = Handle(goal, True, self.time)
            self.grips.append(goal.command)
            result = GripperCommand.Result(stalled=self.stalls, reached_goal=not self.stalls)
            handle.end(ABORTED if self.stalls else SUCCEEDED, result)
        else:
            points = goal.trajectory.points
            times = [seconds_of(point.time_from_start) for point in points]
            valid = sorted(goal.trajectory.joint_names) == sorted(self.names)
            valid &= bool((np.diff(times) > 0).all()) and not any(points[-1].velocities)
            handle = Handle(goal, valid and self.mode != "reject", self.time)
            if handle.accepted:
                self.goals.append(handle)
        if self.mode != "silent":
            self.pending.append((future, handle))
        return future

    def follow(self, handle):
        since, result = self.time - handle.began, FollowJointTrajectory.Result()
        curve = spline(handle)
        if handle.cancelled:
            handle.end(CANCELED, result)
        elif self.mode == "abort" and since > 0.05:
            result.error_code, result.error_string = -4, "path tolerance"
            handle.end(ABORTED, result)
        else:
            self.joints = curve(min(since, curve.x[-1]))
            if since >= curve.x[-1] and self.mode != "no result":
                handle.end(SUCCEEDED, result)

    def modules(self):
        executor = SimpleNamespace(
            add_node=lambda node: True, spin_once=lambda timeout_sec: self.step(STEP)
        )
        now = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(self.time * 1e9)))
        node = SimpleNamespace(
            create_subscription=lambda kind, topic, callback, qos: self.subscriptions.update(
                {topic: callback}
            ),
            get_clock=lambda: now,
        )
        client = SimpleNamespace(
            wait_for_server=lambda timeout_sec: self.mode != "no server",
            send_goal_async=self.send,
        )
        status = SimpleNamespace(
            STATUS_SUCCEEDED=SUCCEEDED, STATUS_CANCELED=CANCELED, STATUS_ABORTED=ABORTED
        )
        return {
            "rclpy": {"ok": lambda: bool(self.inits), "create_node": lambda name: node,
                      "init": lambda **options: self.inits.append(options)},
            "rclpy.action": {"ActionClient": lambda node, kind, name: client},
            "rclpy.duration": {"Duration": lambda seconds: SimpleNamespace(
                to_msg=lambda: stamped(seconds))},
            "rclpy.executors": {"SingleThreadedExecutor": lambda: executor},
            "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
            "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO=0)},
            "action_msgs.msg": {"GoalStatus": status},
            "control_msgs.action": {"FollowJointTrajectory": FollowJointTrajectory,
                                    "GripperCommand": GripperCommand},
            "trajectory_msgs.msg": {"JointTrajectoryPoint": Point},
            "sensor_msgs.msg": {"Image": Image, "CameraInfo": CameraInfo, "JointState": JointState},
            "message_filters": {"Subscriber": Subscriber,
                                "ApproximateTimeSynchronizer": Synchronizer},
        }  # fmt: skip


class Subscriber:
    def __init__(self, node, kind, topic, qos_profile):
        self.callbacks = []
        node.create_subscription(kind, topic, self.receive, qos_profile)

    def receive(self, message):
        for callback in self.callbacks:
            callback(message)


class Synchronizer:
    """Of messages that come in turn."""

    def __init__(self, filters, queue_size, slop):
        self.latest = [None] * len(filters)
        for i, one in enumerate(filters):
            one.callbacks.append(lambda message, i=i: self.add(i, message))

    def registerCallback(self, callback):  # noqa: N802
        self.callback = callback

    def add(self, i, message):
        self.latest[i] = message
        if i == len(self.latest) - 1:
            self.callback(*self.latest)


def spline(handle):
    """Joints (n,) over time."""
    points = handle.goal.trajectory.points
    return CubicHermiteSpline(
        [seconds_of(point.time_from_start) for point in points],
        [point.positions for point in points],
        [point.velocities for point in points],
    )


def install(monkeypatch, ros):
    for name, content in ros.modules().items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setitem(sys.modules, name.partition(".")[0], sys.modules.get(
            name.partition(".")[0], ModuleType(name)))  # fmt: skip


@pytest.fixture
def scara_arm(scara):
    return load_arm(scara, max_speed=2.0, max_acceleration=20.0)


@pytest.fixture
def ros(scara_arm, monkeypatch):
    ros = Ros(list(scara_arm.joints), scara_arm.homes[0])
    install(monkeypatch, ros)
    return ros


@pytest.fixture
def robot(ros, scara_arm):
    return Ros2Arm(Ros2Config(scara_arm, timeout=1.0))


def tips(arm, handle, count=50):
    """Positions (count, 3) of the tip on a trajectory."""
    curve = spline(handle)
    return arm.tip_positions(curve(np.linspace(0.0, curve.x[-1], count)))


def test_a_move_is_a_straight_line_from_rest_to_rest_in_its_time(robot, ros, scara_arm):
    begin, joints, time = robot.position, ros.joints, ros.time
    target = begin + [0.02, -0.05, -0.03]
    robot.move_to(target, 0.8)
    (goal,) = ros.goals
    first, last = goal.goal.trajectory.points[0], goal.goal.trajectory.points[-1]
    assert first.positions == joints.tolist() and seconds_of(first.time_from_start) == 0.0
    assert seconds_of(last.time_from_start) == pytest.approx(0.8)
    assert not any(first.velocities) and not any(last.velocities)
    assert ros.time - time == pytest.approx(0.8, abs=0.06)
    path = tips(scara_arm, goal) - begin
    along = path @ (target - begin) / 0.06164**2
    np.testing.assert_allclose(path, along[:, None] * (target - begin), atol=5e-4)
    np.testing.assert_allclose(robot.position, target, atol=5e-4)


def test_a_move_keeps_the_joints_speeds_and_accelerations(robot, ros, scara_arm):
    robot.move_to(robot.position + [-0.1, -0.25, 0.0], 0.1)
    curve = spline(ros.goals[0])
    times = np.linspace(0.0, curve.x[-1], 500)
    speed, acceleration = (np.abs(curve(times, order)).max() for order in (1, 2))
    assert curve.x[-1] > 0.3 and speed <= 2.0 * 1.01 and acceleration <= 20.0 * 1.01
    assert speed > 1.8 or acceleration > 18.0


def test_announced_moves_are_one_trajectory_across_the_strand(robot, ros, scara_arm):
    begin, count = robot.position, 12
    path = begin + np.arange(1, count + 1)[:, None] / count * [0.02, -0.1, -0.05]
    assert robot.expect(path, 0.1, strand=2.0)
    for position in path:
        time = ros.time
        robot.move_to(position, 0.1)
        np.testing.assert_allclose(
            scara_arm.tip_positions(ros.joints[None])[0], position, atol=4e-3
        )
        assert 0.05 < ros.time - time < 0.3
    assert len(ros.goals) == 1
    np.testing.assert_allclose(robot.position, path[-1], atol=5e-4)
    solver = Solver(scara_arm, scara_arm.base)
    assert np.sin(solver.yaw(ros.joints, 0.0) - 2.0) == pytest.approx(0.0, abs=0.05)


def test_a_motion_is_raised_as_a_whole_to_clear_the_table(robot, ros, scara_arm):
    low = robot.position + [0.0, 0.0, 0.005 - robot.position[2]]
    robot.move_to(low, 1.0)
    np.testing.assert_allclose(robot.position, low, atol=5e-4)
    np.testing.assert_allclose(scara_arm.tip_positions(ros.joints[None])[0, 2], LOWEST, atol=5e-4)


def test_another_move_than_announced_cancels_the_rest(robot, ros):
    begin = robot.position
    path = begin + np.arange(1, 11)[:, None] * [0.0, -0.01, 0.0]
    robot.expect(path, 0.1)
    robot.move_to(path[0], 0.1)
    robot.move_to(begin, 0.5)
    assert ros.goals[0].cancelled and not ros.goals[1].cancelled
    np.testing.assert_allclose(robot.position, begin, atol=5e-4)


def test_fingers_open_as_far_as_they_are_told(robot, ros):
    def commanded():
        return [one.position for one in ros.grips]

    config = robot.config
    robot.open_to(config.widest / 2)
    half = (config.opened + config.closed) / 2
    assert commanded()[-1] == pytest.approx(half)
    robot.grasp()
    robot.open_to(config.widest)
    assert commanded()[-1] == config.closed  # not before it lets go
    robot.release()
    assert commanded()[-1] == config.opened


def test_opening_the_fingers_ends_an_announced_motion(robot, ros):
    begin = robot.position
    path = begin + np.arange(1, 31)[:, None] * [0.0, -0.01, 0.0]
    robot.expect(path, 0.1)
    robot.move_to(path[0], 0.1)
    robot.release()
    assert ros.goals[0].cancelled
    assert np.linalg.norm(robot.position - path[-1]) > 0.2


def test_ctrl_c_is_left_to_python(robot, ros):
    assert ros.inits == [{"args": [], "signal_handler_options": 0}]


def test_a_robot_that_stands_gets_no_goal_but_waits(robot, ros):
    time = ros.time
    robot.move_to(robot.position, 0.3)
    assert not ros.goals and ros.time - time == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize(
    ("mode", "reason", "sent"),
    [
        ("reject", "the goal was rejected", 0),
        ("abort", "aborted, error -4 path tolerance", 1),
        ("no result", "no result 1 s after it was due", 1),
        ("silent", "no answer for 1 s", 1),
        ("no joints", "no new state of shoulder, elbow, lift, wrist on /joint_states", 0),
    ],
)
def test_a_motion_that_fails_is_an_error(robot, ros, mode, reason, sent):
    target = robot.position + [0.0, -0.05, 0.0]
    ros.mode = mode
    ros.step(0.2)  # and joint states are old
    with pytest.raises(Ros2Error, match=reason):
        robot.move_to(target, 0.2)
    assert len(ros.goals) == sent
    if mode == "no result":
        assert ros.goals[0].cancelled


def test_a_position_out_of_reach_is_an_error_before_anything_moves(robot, ros):
    with pytest.raises(Ros2Error, match=r"scara cannot move in a line .* out of reach"):
        robot.move_to(np.array([2.0, 0.0, 0.2]), 1.0)
    assert not ros.goals


def test_the_gripper_may_stall_on_the_rope_but_not_on_its_way_open(robot, ros):
    ros.stalls = True
    robot.grasp()
    with pytest.raises(Ros2Error, match="gripper_cmd: aborted at 0, on the way to 0.04"):
        robot.release()
    ros.stalls = False
    robot.release()
    robot.release()
    assert [(one.position, one.max_effort) for one in ros.grips] == [
        (0.04, 10.0), (0.0, 10.0), (0.04, 10.0), (0.04, 10.0)
    ]  # fmt: skip


def show(ros, rgb, depth, d=(0.0,) * 5):
    """Set the camera's image: encodings and pixels."""
    for image, (encoding, pixels) in zip(ros.images, (rgb, depth), strict=False):
        height, width = pixels.shape[:2]
        rows = pixels.reshape(height, -1).view(np.uint8)
        image.height, image.width, image.encoding = height, width, encoding
        image.step, image.is_bigendian = rows.shape[1] + 4, int(pixels.dtype.byteorder == ">")
        image.data = np.pad(rows, ((0, 0), (0, 4))).tobytes()  # rows may be padded
    info = ros.images[2]
    info.height, info.width, info.d = height, width, list(d)
    info.k = [100.0, 0.0, width / 2, 0.0, 100.0, height / 2, 0.0, 0.0, 1.0]


COLOUR = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
METRES = np.full((4, 5), 0.75, np.float32)
METRES[0, 0] = np.nan


@pytest.mark.parametrize(
    ("colour", "depth"),
    [
        (("rgb8", COLOUR), ("16UC1", np.nan_to_num(METRES * 1e3).astype("<u2"))),
        (("bgr8", COLOUR[..., ::-1].copy()), ("32FC1", METRES)),
        (("rgb8", COLOUR), ("16UC1", np.nan_to_num(METRES * 1e3).astype(">u2"))),
    ],
)
def test_images_are_decoded(robot, ros, colour, depth):
    show(ros, colour, depth)
    image = robot.observe()
    np.testing.assert_array_equal(image.rgb, COLOUR)
    np.testing.assert_allclose(image.depth, METRES)
    assert 0.0 <= ros.time - image.time < 0.1


def test_distortion_is_taken_out_unless_the_topics_are_rectified(robot, ros, scara_arm):
    show(ros, ("rgb8", COLOUR), ("32FC1", METRES), d=(400.0, 0.0, 0.0, 0.0, 0.0))
    straightened = robot.observe()
    rectified = Ros2Arm(Ros2Config(scara_arm, rectified=True)).observe()
    np.testing.assert_array_equal(rectified.rgb, COLOUR)
    assert straightened.rgb.shape == COLOUR.shape and (straightened.rgb != COLOUR).any()


def test_an_unknown_encoding_is_named(robot, ros):
    show(ros, ("yuv422", COLOUR), ("32FC1", METRES))
    with pytest.raises(ValueError, match="'yuv422'; those of rgb8, bgr8, 16UC1, 32FC1"):
        robot.observe()


def test_an_image_is_of_after_the_motion(robot, ros):
    show(ros, ("rgb8", COLOUR), ("32FC1", METRES))
    robot.observe()
    robot.move_to(robot.position + [0.0, -0.05, 0.0], 0.5)
    ended = ros.time
    assert robot.observe().time > ended - STEP
    ros.camera_delay = 3.0
    robot.move_to(robot.position + [0.0, 0.05, 0.0], 0.5)
    with pytest.raises(Ros2Error, match=r"images are \d\.\d\d s older .* clocks of camera"):
        robot.observe()
    ros.mode = "no images"
    ros.step(5.0)
    with pytest.raises(TimeoutError, match="no images on /camera"):
        robot.observe()


def test_what_is_missing_is_named(robot, ros, scara_arm, monkeypatch):
    ros.mode = "no server"
    with pytest.raises(Ros2Error, match="no action server /joint_trajectory_controller"):
        Ros2Arm(Ros2Config(scara_arm))
    monkeypatch.setitem(sys.modules, "control_msgs.action", None)
    with pytest.raises(ImportError, match=r"needs rclpy, control_msgs .* source its setup\.bash"):
        Ros2Arm(Ros2Config(scara_arm))


def test_a_goal_that_fails_ends_a_run_with_the_fingers_open(robot, ros, tmp_path, monkeypatch):
    twin = Twin(straight(RopeConfig()), TwinConfig(level=0), np.random.default_rng(0))
    monkeypatch.setattr(lab, "ImageStateEstimator", lambda camera, rope: TrueState(twin))
    robot.grasp()
    target = (robot.position + [0.0, -0.1, 0.0]).tolist()
    ros.mode = "abort"
    with RunLog(tmp_path / "run.mcap", {}) as log:
        done = lab.tie(
            "R1(0,1,1)", robot, Camera.overhead(), RopeConfig(), None, None, log,
            ExecutionConfig(park_position=target),
        )  # fmt: skip
    assert not done.tied and done.reason.startswith("the robot failed at move_to: Ros2Error(")
    assert "aborted, error -4 path tolerance" in done.reason
    assert ros.grips[-1].position == pytest.approx(0.04)


@pytest.mark.slow
def test_a_plan_is_a_trajectory_a_phase_and_the_fingers_close_across(still, monkeypatch):
    arm = ur5e()
    solver = Solver(arm, arm.base)
    ros = Ros(list(arm.joints), solver.home_towards(np.array([0.0, 0.0, 0.3]))[solver.columns])
    install(monkeypatch, ros)
    robot = Ros2Arm(Ros2Config(arm))
    held = []
    grasp = robot.grasp
    monkeypatch.setattr(robot, "grasp", lambda: (held.append(ros.joints), grasp()))
    done = execute(replace(still, steps=still.steps[:1]), robot)
    assert len(ros.goals) == 4 and len(held) == 1
    yaw = solver.yaw(held[0], 0.0)  # across the rope, which lies along x
    assert np.sin(yaw) == pytest.approx(0.0, abs=0.05)
    assert [one.position for one in ros.grips] == [0.04, 0.0, 0.04]
    travelled = np.concatenate([tips(arm, goal, 200) for goal in ros.goals])
    for position in done.gripper:
        assert np.linalg.norm(travelled - position, axis=1).min() < 5e-3

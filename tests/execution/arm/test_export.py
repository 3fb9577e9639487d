import csv
import io
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from knotflow.execution import ArmError, Base, export_plan, load_arm, panda
from knotflow.execution.arm.inverse_kinematics import TOLERANCE
from knotflow.execution.arm.model import PREFIX, TABLE
from knotflow.planning import Frame

UPRIGHT = Base([-0.5, 0.0, 0.0])


@pytest.fixture(scope="module")
def exported(still):
    return export_plan(still, "panda", UPRIGHT)


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def columns(text, names):
    return np.array([[float(row[name]) for name in names] for row in rows(text)])


def test_exported_joints_reach_every_waypoint(exported):
    arm, waypoints = panda(), exported.waypoints
    model = arm.model(UPRIGHT)
    data = mujoco.MjData(model)
    joints = columns(exported.text, arm.joints)
    names = [PREFIX + name for name in arm.joints]
    ranges = model.jnt_range[[model.joint(name).id for name in names]]
    assert exported.reachable
    assert (joints >= ranges[:, 0]).all() and (joints <= ranges[:, 1]).all()
    for configuration, wanted in zip(joints, waypoints.positions, strict=True):
        data.qpos[[model.jnt_qposadr[model.joint(name).id] for name in names]] = configuration
        mujoco.mj_forward(model, data)
        tip = data.site(PREFIX + arm.tip)
        assert np.linalg.norm(tip.xpos - wanted) < TOLERANCE
        touching = {model.geom(geom).name for pair in data.contact.geom for geom in pair}
        assert TABLE not in touching


def test_frame_of_the_measured_rope_is_that_of_base_and_poses(still, exported):
    frame = Frame(Rotation.from_rotvec([0.2, -0.1, 0.4]).as_matrix(), 0.3)
    rpy = Rotation.from_matrix(frame.rotation).as_euler("xyz", degrees=True)
    base = Base(frame.to_file(UPRIGHT.position).tolist(), rpy.tolist())
    there = export_plan(replace(still, frame=frame), "panda", base, space="cartesian")
    np.testing.assert_allclose(there.ik.joints, exported.ik.joints, atol=1e-4)
    positions = columns(there.text, ["x_m", "y_m", "z_m"])
    expected = frame.to_file(exported.ik.positions)
    np.testing.assert_allclose(positions, expected, atol=1e-4)
    quaternions = columns(there.text, ["qw", "qx", "qy", "qz"])
    down = Rotation.from_quat(quaternions, scalar_first=True).apply([0.0, 0.0, 1.0])
    tilt = np.arccos(np.clip(-down @ frame.rotation[:, 2], -1, 1))
    np.testing.assert_allclose(tilt, exported.ik.tilt, atol=1e-3)


@pytest.mark.parametrize("max_speed", [0.1, 0.25])
def test_speed_limits_hold(still, max_speed):
    arm = panda()
    exported = export_plan(still, arm, UPRIGHT, max_speed, rate_hz=10.0)
    seconds = np.diff(columns(exported.text, ["time_s"]), axis=0)
    assert (seconds > 0).all()
    places = exported.ik.positions
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert (speed <= max_speed * seconds[:, 0] + 3e-6).all()  # what rounding adds
    turning = np.abs(np.diff(columns(exported.text, arm.joints), axis=0))
    assert (turning <= arm.max_speed * seconds + 3e-6).all()
    peaks = exported.peaks()
    assert peaks["tip_speed"] <= max_speed * (1 + 1e-9)
    assert max(peaks["joint_speed"], peaks["joint_acceleration"]) <= 1 + 1e-6


@pytest.mark.parametrize("arm", ["panda", "ur5e", "xarm7"])
def test_limits_hold_on_the_cubics_that_a_controller_follows(still, arm):
    exported = export_plan(still, arm, format="ros2")
    points = yaml.safe_load(exported.text)["points"]
    joints, rates = (
        np.array([one[key][:-1] for one in points]) for key in ("positions", "velocities")
    )
    curve = CubicHermiteSpline(exported.times, joints, rates)
    at = np.interp(np.linspace(0, 1, 20 * len(joints)), np.linspace(0, 1, len(joints)), curve.x)
    assert (np.abs(curve(at, 1)) <= 1.01 * exported.arm.max_speed).all()
    assert (np.abs(curve(at, 2)) <= 1.01 * exported.arm.max_acceleration).all()


def test_fingers_close_across_the_strand(exported, still):
    for index in range(len(still.steps)):
        grasp = np.flatnonzero(
            (exported.waypoints.step == index) & (np.array(exported.waypoints.phases) == "close")
        )[0]
        w, x, y, z = exported.ik.quaternions[grasp]
        along, across = 2 * (x * y - w * z), w * w - x * x + y * y - z * z
        assert abs(along) < 0.05  # the rope lies along x
        assert abs(across) > 0.99


@pytest.mark.slow
def test_unreachable_waypoints_are_named(still):
    far = export_plan(still, "panda", Base([-1.1, 0.0, 0.0]), rate_hz=2.0)
    missed = np.flatnonzero(~far.ik.ok)
    assert not far.reachable and len(missed)
    assert f"{len(missed)} waypoints cannot be reached" in far.summary()
    assert f"  {missed[0]} to " in far.summary()
    assert [i for i, row in enumerate(rows(far.text)) if row["reached"] == "0"] == missed.tolist()


@pytest.mark.slow
def test_ros2_messages(still):
    csv_like = export_plan(still, "panda", UPRIGHT, rate_hz=5.0)
    joint = yaml.safe_load(export_plan(still, "panda", UPRIGHT, format="ros2", rate_hz=5.0).text)
    assert set(joint) == {"header", "joint_names", "points"}
    assert len(joint["joint_names"]) == 8
    stamps = [one["time_from_start"] for one in joint["points"]]
    times = np.array([stamp["sec"] + stamp["nanosec"] * 1e-9 for stamp in stamps])
    np.testing.assert_allclose(times, csv_like.times, atol=1e-8)
    arm_joints = np.array([one["positions"][:7] for one in joint["points"]])
    np.testing.assert_allclose(arm_joints, csv_like.ik.joints, atol=1e-6)
    text = export_plan(still, "panda", UPRIGHT, format="ros2", space="cartesian", rate_hz=5.0).text
    place = yaml.safe_load(text)["points"][-1]["transforms"][0]["translation"]
    last = csv_like.ik.positions[-1]
    np.testing.assert_allclose([place["x"], place["y"], place["z"]], last, atol=1e-6)


def test_gripper_moves_while_the_arm_stands(exported):
    opening = columns(exported.text, ["panda_finger_joint1"])[:, 0]
    phases = np.array([row["phase"] for row in rows(exported.text)])
    wide, narrow = panda().opening
    assert set(opening[np.isin(phases, ["travel", "descend", "rise"])]) == {wide}
    assert set(opening[phases == "drag"]) == {narrow}


def test_loaded_arm_executes_a_plan(still, scara):
    exported = export_plan(still, load_arm(scara), Base([-0.4, -0.3, 0.0]), rate_hz=10.0)
    assert exported.reachable, exported.summary()
    assert exported.peaks()["joint_speed"] <= 1 + 1e-6


def test_invalid_exports_are_refused(still):
    with pytest.raises(ArmError, match="csv or ros2"):
        export_plan(still, format="urscript")
    with pytest.raises(ArmError, match="joint or cartesian"):
        export_plan(still, space="tool")
    with pytest.raises(ArmError, match="above 0 m/s"):
        export_plan(still, max_speed=0.0)
    with pytest.raises(ArmError, match="no steps"):
        export_plan(replace(still, steps=()))

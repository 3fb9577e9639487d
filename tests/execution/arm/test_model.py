import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotflow.execution import export_plan
from knotflow.execution.arm.model import (
    ARMS,
    PREFIX,
    Arm,
    ArmError,
    Base,
    find_arm,
    load_arm,
    panda,
)


def placed(arm: Arm, base: Base, joints) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and rotation (3, 3) of the tip by forward kinematics."""
    model = arm.model(base)
    data = mujoco.MjData(model)
    data.qpos[[model.jnt_qposadr[model.joint(PREFIX + name).id] for name in arm.joints]] = joints
    mujoco.mj_forward(model, data)
    tip = data.site(PREFIX + arm.tip)
    return tip.xpos.copy(), tip.xmat.reshape(3, 3).copy()


def test_panda_ready_pose_is_frankas():
    # Franka's ready pose holds the flange 0.3069 m before and 0.5903 m above the base.
    position, rotation = placed(
        panda(), Base(), [0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, 0]
    )
    np.testing.assert_allclose(position[[0, 1]], [0.3069, 0.0], atol=1e-4)
    assert position[2] + 0.1054 == pytest.approx(0.5903, abs=1e-4)
    np.testing.assert_allclose(rotation[:, 2], [0, 0, -1], atol=1e-12)


DH = {
    # Universal Robots' UR5e: a, d (metres) and alpha (degrees) of each link, standard convention.
    "ur5e": (
        [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0],
        [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
        [90, 0, 0, 90, -90, 0],
    ),
    # UFACTORY's xArm7: a and alpha of the link before, Craig's convention.
    "xarm7": (
        [0.0, 0.0, 0.0, 0.0525, 0.0775, 0.0, 0.076],
        [0.267, 0.0, 0.293, 0.0, 0.3425, 0.0, 0.097],
        [0, -90, 90, 90, 90, 90, -90],
    ),
}
TIPS = {"ur5e": 0.154, "xarm7": 0.166}  # from the flange, metres


def rigid(rotation=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(rotation).as_matrix(), shift
    return pose


@pytest.mark.parametrize("name", DH)
def test_kinematics_are_the_product_of_published_parameters(name):
    arm, pose = find_arm(name), np.eye(4)
    joints = np.random.default_rng(0).uniform(-1.0, 1.0, len(arm.joints))
    for a, d, alpha, joint in zip(*DH[name], joints, strict=True):
        turned = rigid((0, 0, joint), (0, 0, d))
        link = rigid((np.deg2rad(alpha), 0, 0), (a, 0, 0))
        pose = pose @ (turned @ link if name == "ur5e" else link @ turned)
    position, rotation = placed(arm, Base(), joints)
    expected = pose @ [0.0, 0.0, TIPS[name], 1.0]
    np.testing.assert_allclose(position, expected[:3], atol=1e-6)
    np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_touches_neither_itself_nor_the_table_at_home(name):
    arm = find_arm(name)
    model = arm.model()
    data = mujoco.MjData(model)
    columns = model.jnt_qposadr[arm.joint_ids(model)]
    downward = []
    for home in arm.homes:
        data.qpos[columns] = home
        mujoco.mj_forward(model, data)
        touching = {frozenset(pair) for pair in data.contact.geom.tolist()}
        downward.append((data.site(PREFIX + arm.tip).xmat[8], len(touching)))
    up, touching = min(downward)
    assert up < -0.95 and touching <= 2  # the base and the links after it


def test_base_moves_the_arm_rigidly():
    arm, joints = panda(), [0.3, -0.5, 0.2, -1.9, 0.4, 1.5, 0.6]
    here, _ = placed(arm, Base(), joints)
    turned, _ = placed(arm, Base([0.1, 0.2, 0.3], [0.0, 0.0, 90.0]), joints)
    np.testing.assert_allclose(turned, [0.1 - here[1], 0.2 + here[0], 0.3 + here[2]], atol=1e-9)
    hung, _ = placed(arm, Base([0.0, 0.0, 1.0], [180.0, 0.0, 0.0]), joints)
    np.testing.assert_allclose(hung, [here[0], -here[1], 1.0 - here[2]], atol=1e-9)


def test_base_is_loaded(tmp_path):
    path = tmp_path / "base.yaml"
    path.write_text("position: [-0.5, 0, 0.1]\nrpy_deg: [0, 0, 30]\n")
    assert Base.load(path) == Base([-0.5, 0, 0.1], [0, 0, 30])


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("position: [1, 2]\n", "three numbers"),
        ("position: [0, 0, .nan]\n", "three numbers"),
        ("position: here\n", "three numbers"),
        ("yaw: 3\n", "rpy_deg"),
        ("- 1\n", "mapping"),
        ("", "it holds None"),
        ("a: [\n", "cannot be read"),
    ],
)
def test_invalid_base_files_are_refused(tmp_path, text, word):
    path = tmp_path / "base.yaml"
    path.write_text(text)
    with pytest.raises(ArmError, match=rf"base\.yaml: .*{word}"):
        Base.load(path)


def test_arm_is_loaded_from_mjcf(scara):
    arm = load_arm(scara)
    assert (arm.tip, arm.joints) == ("fingers", ("shoulder", "elbow", "lift", "wrist"))
    np.testing.assert_array_equal(arm.homes, [[0.5, -1.0, -0.05, 0.0]])


def test_unusable_arms_are_refused(scara, tmp_path):
    with pytest.raises(ArmError, match="there is no such arm"):
        load_arm(tmp_path / "none.xml")
    with pytest.raises(ArmError, match="'hand' is none of fingers"):
        load_arm(scara, tip="hand")
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody>")
    with pytest.raises(ArmError, match="cannot read"):
        load_arm(broken)


UR5E_JOINTS = (
    ("pan", "0 0 0.1625", "0 0 0", 3.1),
    ("lift", "0 0 0", "1.5708 0 0", 3.1),
    ("elbow", "-0.425 0 0", "0 0 0", 3.1),
    ("wrist_1", "-0.3922 0 0.1333", "0 0 0", 6.2),
    ("wrist_2", "0 -0.0997 0", "1.5708 0 0", 6.2),
    ("wrist_3", "0 0.0996 0", "1.5708 3.1416 3.1416", 6.2),
)
"""Name, origin and speed limit of a UR5e's joints, as in Universal Robots' description."""


@pytest.fixture
def urdf(tmp_path):
    mesh = '<geometry><mesh filename="package://lab/missing.dae"/></geometry>'
    links = "".join(
        f'<link name="{name}"><visual>{mesh}</visual><collision>{mesh}</collision></link>'
        for name in ["base", *(f"{joint}_link" for joint, *_ in UR5E_JOINTS)]
    )
    parents = ["base", *(f"{name}_link" for name, *_ in UR5E_JOINTS)]
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
        f'<limit lower="-6.28" upper="6.28" effort="100" velocity="{speed}"/></joint>'
        for (name, xyz, rpy, speed), parent in zip(UR5E_JOINTS, parents, strict=False)
    )
    fingers = (
        '<link name="fingers"/><joint name="mount" type="fixed"><parent link="wrist_3_link"/>'
        '<child link="fingers"/><origin xyz="0 0 0.14"/></joint>'
    )
    path = tmp_path / "lab.urdf"
    path.write_text(f'<robot name="lab">{links}{joints}{fingers}</robot>')
    return path


def test_joints_limits_and_tip_are_those_of_a_urdf(urdf):
    arm = load_arm(urdf, tip="fingers")
    assert arm.joints == tuple(name for name, *_ in UR5E_JOINTS)
    np.testing.assert_array_equal(arm.max_speed, [speed for *_, speed in UR5E_JOINTS])
    stretched = arm.tip_positions(np.zeros((1, 6)))[0]
    np.testing.assert_allclose(stretched, [-0.8172, -0.3729, 0.0628], atol=1e-3)
    with pytest.raises(ArmError, match="wrist_3_link, fingers"):
        load_arm(urdf)


@pytest.mark.slow
def test_a_plan_is_followed_by_an_arm_of_a_urdf(urdf, still):
    arm = load_arm(urdf, tip="fingers")
    exported = export_plan(still, arm, Base([-0.3, 0.0, 0.65], [0.0, -90.0, 180.0]), rate_hz=10.0)
    assert exported.reachable, exported.summary()


def test_a_speed_limit_that_is_no_number_is_told(urdf):
    urdf.write_text(urdf.read_text().replace('velocity="3.1"', 'velocity="fast"'))
    with pytest.raises(ArmError, match="lab.urdf: the velocity of a limit is a number: .*fast"):
        load_arm(urdf, tip="fingers")


NAMELESS = """<mujoco><worldbody><body><joint{joint} axis="0 0 1"/><geom size="0.1"/>
<site/><site name="tip"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("joint", "valid"), [(' name="turn"', True), ("", False)])
def test_sites_may_lack_names_and_joints_may_not(tmp_path, joint, valid):
    (tmp_path / "arm.xml").write_text(NAMELESS.format(joint=joint))
    if valid:
        assert load_arm(tmp_path / "arm.xml").joints == ("turn",)
    else:
        with pytest.raises(ArmError, match="a joint that moves 'tip' has no name"):
            load_arm(tmp_path / "arm.xml")

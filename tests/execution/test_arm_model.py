import mujoco
import numpy as np
import pytest

from knotflow.execution.arm_model import PREFIX, Arm, ArmError, Base, load_arm, panda


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

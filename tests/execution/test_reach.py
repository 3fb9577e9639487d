import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotflow.execution import ArmReach, Base, export_plan, find_arm
from knotflow.execution.reach import Chain
from knotflow.planning import Frame, Placement


@pytest.fixture(scope="module")
def reach(still):
    return ArmReach("ur5e", radius=still.radius)


def test_chain_is_the_models_kinematics():
    arm = find_arm("xarm7")
    joints = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 7))
    chain = Chain(arm, arm.base)
    tips, _, jacobian = chain.tips(joints)
    np.testing.assert_allclose(tips, arm.tip_positions(joints), atol=1e-9)
    step = 1e-6 * np.ones(7)
    moved = (chain.tips(joints + step)[0] - chain.tips(joints - step)[0]) / 2e-6
    np.testing.assert_allclose(jacobian[:, :3] @ np.ones(7), moved, atol=1e-6)


@pytest.mark.slow
def test_filter_and_exact_check_agree(reach, still):
    assert reach.may_follow(still.start, still.splines).all()
    assert export_plan(still, "ur5e").reachable
    assert reach.first_unreached(still) is None


def test_splines_beyond_reach_or_too_fast_are_refused(still):
    splines = still.splines
    far = ArmReach("ur5e", Base([-1.1, 0.0, 0.65], [0.0, -90.0, 180.0]), radius=still.radius)
    assert not far.may_follow(still.start, splines).any()
    slow = ArmReach("ur5e", radius=still.radius, max_speed=8.0)  # faster than the joints
    assert not slow.may_follow(still.start, splines).any()


def test_reach_is_of_the_measured_rope(reach, still):
    """What is searched for about the origin lies elsewhere, and the base is given in its frame."""
    turn = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    frame, placement = Frame(turn, 0.3), Placement(1.0, 0.4, -0.2)
    base = reach.arm.base
    pose = Rotation.from_euler("xyz", base.rpy_deg, degrees=True)
    there = Base(
        frame.to_file(np.add(base.position, [0.4, -0.2, 0.0])).tolist(),
        (Rotation.from_matrix(turn) * pose).as_euler("xyz", degrees=True).tolist(),
    )
    moved = ArmReach("ur5e", there, radius=still.radius, placement=placement, frame=frame)
    assert moved.may_follow(still.start, still.splines).all()
    away = ArmReach("ur5e", base, radius=still.radius, placement=Placement(1.0, 1.0, 0.0))
    assert not away.may_follow(still.start, still.splines).any()

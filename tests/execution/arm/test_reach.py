import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotflow.execution import ArmReach, Base, export_plan, find_arm, first_untied
from knotflow.execution.arm.reach import Chain
from knotflow.planning import Frame, Placement
from knotflow.simulation import SimulationConfig

SIMULATION = SimulationConfig()


@pytest.fixture(scope="module")
def reach():
    return ArmReach("ur5e", simulation=SIMULATION)


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
def test_filter_and_exact_check_agree(reach, still, plan):
    assert reach.may_follow(still.start, still.splines).all()
    assert export_plan(still, "ur5e").reachable
    assert reach.may_follow(plan.start, plan.splines).all()
    assert reach.first_failed(plan) is None


def test_splines_beyond_reach_or_too_fast_are_refused(still):
    splines = still.splines
    far = ArmReach("ur5e", Base([-1.1, 0.0, 0.65], [0.0, -90.0, 180.0]), simulation=SIMULATION)
    assert not far.may_follow(still.start, splines).any()
    slow = ArmReach("ur5e", simulation=SIMULATION, max_speed=8.0)  # faster than the joints
    assert not slow.may_follow(still.start, splines).any()


def test_arm_must_reach_above_the_pile(reach, still):
    pile = still.start.copy()
    pile[len(pile) // 2, 2] = 1.5
    assert not reach.may_follow(pile, still.splines).any()


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
    moved = ArmReach("ur5e", there, simulation=SIMULATION, placement=placement, frame=frame)
    assert moved.may_follow(still.start, still.splines).all()
    away = ArmReach("ur5e", base, simulation=SIMULATION, placement=Placement(1.0, 1.0, 0.0))
    assert not away.may_follow(still.start, still.splines).any()


@pytest.mark.slow
def test_plans_are_tied_as_exported_wherever_the_rope_was_measured(plan):
    turn = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    frame, placement = Frame(turn, 0.3), Placement(1.0, 0.02, -0.01)
    export = export_plan(plan, "ur5e")
    assert first_untied(plan, export, SIMULATION) is None
    placed = plan.placed(placement, frame)
    base = find_arm("ur5e").base
    pose = Rotation.from_euler("xyz", base.rpy_deg, degrees=True)
    there = Base(
        frame.to_file(np.add(base.position, [0.02, -0.01, 0.0])).tolist(),
        (Rotation.from_matrix(turn) * pose).as_euler("xyz", degrees=True).tolist(),
    )
    moved = export_plan(placed, "ur5e", there)
    assert first_untied(plan, moved, SIMULATION, placement, frame) is None
    assert first_untied(plan, moved, SIMULATION) == 0  # grasps beside the rope

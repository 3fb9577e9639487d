"""Laws of the rope model: posed from its vertices, it has these vertices."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from knotflow.simulation import (
    RopeConfig,
    ShapeError,
    build_model,
    check_points,
    pose,
    random_curve,
    straight,
)


def vertices(model, qpos):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    rope_links = sum(1 for i in range(model.nsite) if model.site(i).name.startswith("vertex_"))
    return np.array([data.site(f"vertex_{i}").xpos for i in range(rope_links)])


def spatial_curve(rope, rng):
    """A curve that leaves the table, bending less than the hinges allow."""
    direction = np.array([1.0, 0.0, 0.0])
    points = [np.array([0.0, 0.0, 0.2])]
    for _ in range(rope.links):
        direction = direction + rng.normal(0, 0.25, 3)
        direction /= np.linalg.norm(direction)
        points.append(points[-1] + rope.link_length * direction)
    return np.array(points)


@pytest.mark.parametrize("links", [4, 9, 40, 61])
@pytest.mark.parametrize("make", [random_curve, spatial_curve])
def test_posed_rope_has_the_given_vertices(links, make, rng):
    rope = RopeConfig(links=links)
    model = build_model(rope)
    points = np.stack([make(rope, rng) for _ in range(5)])
    for given, qpos in zip(points, pose(points, rope), strict=True):
        np.testing.assert_allclose(vertices(model, qpos), given, atol=1e-6)


def test_rope_heading_backwards_and_up_is_posed():
    rope = RopeConfig(links=8)
    points = rope.link_length * np.arange(9)[:, None] * [-0.8, 0.0, 0.6] + [0.5, 0.0, 0.1]
    qpos = pose(points[None], rope)[0]
    np.testing.assert_allclose(vertices(build_model(rope), qpos), points, atol=1e-6)
    np.testing.assert_allclose(qpos[7:], 0, atol=1e-9)  # a straight rope bends no hinge


def test_only_roll_of_the_root_is_damped():
    rope = RopeConfig()
    model = build_model(rope)
    assert np.flatnonzero(model.dof_damping[:6]).tolist() == [3]
    assert np.flatnonzero(model.dof_armature[:6]).tolist() == [3]
    data = mujoco.MjData(model)
    data.qpos[3:7] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]  # the rope points along y
    data.qvel[3] = 1.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    velocity = np.zeros(6)
    link = model.body(f"link_{rope.root_link}").id
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, link, velocity, 0)
    np.testing.assert_allclose(velocity[:3], [0, 1, 0], atol=1e-9)


def test_every_link_can_be_grasped():
    rope = RopeConfig(links=12)
    model = build_model(rope)
    assert model.neq == rope.links
    assert not model.eq_active0.any()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda p: p[:-1], r"shape \(\.\.\., 41, 3\)"),
        (lambda p: p[..., :2], "41, 3"),
        (lambda p: np.where(np.arange(41)[:, None] == 3, np.nan, p), r"points\[3, 0\] is not"),
        (lambda p: p * 1.1, "25.00 mm long"),
    ],
)
def test_invalid_points_are_rejected(damage, message):
    rope = RopeConfig()
    with pytest.raises(ShapeError, match=message):
        check_points(damage(straight(rope)), rope)


def test_points_of_equal_links_are_unchanged(rng):
    rope = RopeConfig()
    points = random_curve(rope, rng)
    np.testing.assert_array_equal(check_points(points, rope), points)


def test_checked_points_are_the_posed_shape(rng):
    """Unequal links, within the tolerance: the shape returned is the one that is simulated."""
    rope = RopeConfig(links=20)
    links = np.diff(spatial_curve(rope, rng), axis=0) * rng.uniform(0.991, 1.009, (20, 1))
    given = np.concatenate([np.zeros((1, 3)), np.cumsum(links, axis=0)]) + [0.1, 0, 0.2]
    checked = check_points(given, rope)
    assert np.abs(checked - given).max() > 1e-4
    np.testing.assert_allclose(np.linalg.norm(np.diff(checked, axis=0), axis=1), rope.link_length)
    np.testing.assert_allclose(checked[rope.root_link], given[rope.root_link])
    posed = vertices(build_model(rope), pose(given[None], rope)[0])
    np.testing.assert_allclose(posed, checked, atol=1e-6)
    np.testing.assert_array_equal(check_points(checked, rope), checked)
    stacked = check_points(np.stack([given, given + 0.01]), rope)
    np.testing.assert_allclose(stacked, [checked, checked + 0.01])


@pytest.mark.parametrize("wrong", [{"links": 2}, {"length": 0.0}, {"radius": -1.0}])
def test_invalid_ropes_are_rejected(wrong):
    with pytest.raises(ValueError, match="rope"):
        replace(RopeConfig(), **wrong)


def test_a_whole_number_of_links_may_come_as_a_float():
    assert straight(RopeConfig(links=40.0)).shape == (41, 3)

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


@pytest.mark.parametrize("root", ["middle", "head"])
@pytest.mark.parametrize("links", [4, 9, 40, 61])
@pytest.mark.parametrize("make", [random_curve, spatial_curve])
def test_posed_rope_has_the_given_vertices(links, make, root, rng):
    rope = RopeConfig(links=links, root=root)
    model = build_model(rope)
    points = np.stack([make(rope, rng) for _ in range(5)])
    for given, qpos in zip(points, pose(points, rope), strict=True):
        np.testing.assert_allclose(vertices(model, qpos), given, atol=1e-6)


@pytest.mark.parametrize("root", ["middle", "head"])
def test_a_rope_that_heads_backwards_and_up_is_posed(root):
    rope = RopeConfig(links=8, root=root)
    points = rope.link_length * np.arange(9)[:, None] * [-0.8, 0.0, 0.6] + [0.5, 0.0, 0.1]
    qpos = pose(points[None], rope)[0]
    np.testing.assert_allclose(vertices(build_model(rope), qpos), points, atol=1e-6)
    np.testing.assert_allclose(qpos[7:], 0, atol=1e-9)  # a straight rope bends no hinge


def test_roots_are_coordinates_of_one_rope(rng):
    """Same links in the same places with the same masses, grasps and feet, whatever the root."""
    middle, head = RopeConfig(links=9, root="middle"), RopeConfig(links=9, root="head")
    points = spatial_curve(middle, rng)[None] + [0.1, 0, 0]  # none where the table's centre is
    models = [build_model(rope) for rope in (middle, head)]
    assert models[0].nv == models[1].nv
    assert models[0].nM < models[1].nM
    scenes = []
    for model, rope in zip(models, (middle, head), strict=True):
        data = mujoco.MjData(model)
        data.qpos[:] = pose(points, rope)[0]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        names = [f"{kind}_{i}" for i in range(9) for kind in ("grasp", "vertex")]
        feet = np.argsort(data.geom_xpos[:, 0])
        scenes.append(
            {
                "sites": np.array([data.site(name).xpos for name in names]),
                "links": np.array([data.body(f"link_{i}").xipos for i in range(9)]),
                "masses": np.array([model.body(f"link_{i}").mass for i in range(9)]),
                "geoms": data.geom_xpos[feet],
                "friction": model.geom_condim[feet][:, None],
            }
        )
    for key, value in scenes[0].items():
        np.testing.assert_allclose(value, scenes[1][key], atol=1e-6, err_msg=key)


def _undamped_root(rope):
    model = build_model(rope)
    first = model.joint("root").dofadr[0]
    model.dof_damping[first : first + 6] = 0
    model.dof_armature[first : first + 6] = 0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.opt.tolerance = 1e-14
    return model


def _same_motion(model, rope, other, other_rope, data):
    """The state of `other`, rooted in the head, in the coordinates of `model`."""
    same = mujoco.MjData(model)
    name = f"link_{rope.root_link}"
    mujoco.mj_forward(other, data)
    same.qpos[:7] = np.r_[data.body(name).xpos, data.body(name).xquat]
    body, velocity = other.body(name).id, np.zeros(6)
    for local in (0, 1):  # linear in the world, angular in the link
        mujoco.mj_objectVelocity(
            other, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, flg_local=local
        )
        same.qvel[3 * local : 3 * local + 3] = velocity[:3] if local else velocity[3:]
    towards_head, towards_tail = rope.branches
    hinges = [2 * link + k for link in towards_head for k in (1, 0)]
    hinges += [2 * link - 2 + k for link in towards_tail for k in (0, 1)]
    same.qpos[7:], same.qvel[6:] = data.qpos[7:][hinges], data.qvel[6:][hinges]
    same.mocap_pos[:], same.eq_active[:] = data.mocap_pos, data.eq_active
    return same


def _accelerations(model, data, count):
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    result = np.zeros((count, 6))
    for i, row in enumerate(result):
        site = model.site(f"vertex_{i}").id
        mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_SITE, site, row, 0)
    return result[:, 3:]


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("links", [9, 40])
def test_roots_have_the_same_mechanics(links, moving, rng):
    """Springs, limits, grasp, gravity and contacts accelerate the vertices alike.

    Of a moving rope contacts are left out: MuJoCo drops the derivative of a contact's Jacobian,
    which depends on the coordinates.
    """
    ropes = [RopeConfig(links=links, root=root) for root in ("middle", "head")]
    models = [_undamped_root(rope) for rope in ropes]
    pushed = 0
    for _ in range(5):
        points = spatial_curve(ropes[0], rng)
        points[:, 2] -= points[:, 2].min() - 0.9 * ropes[0].radius  # presses on the table
        middle, head = (mujoco.MjData(model) for model in models)
        grasp = rng.integers(links)
        for model, data, rope in zip(models, (middle, head), ropes, strict=True):
            data.qpos[:] = pose(points[None], rope)[0]
            data.eq_active[grasp] = 1
            mujoco.mj_kinematics(model, data)
            data.mocap_pos[0] = data.site(f"grasp_{grasp}").xpos + [0.003, -0.005, 0.004]
            if moving:
                model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        if moving:
            head.qvel[:] = rng.normal(0, 1, models[1].nv)
            middle = _same_motion(models[0], ropes[0], models[1], ropes[1], head)
        first, second = (
            _accelerations(model, data, links + 1)
            for model, data in zip(models, (middle, head), strict=True)
        )
        np.testing.assert_allclose(first, second, atol=1e-9 * np.abs(second).max())
        assert np.abs(second).max() > 1.0
        pushed += head.nefc - 3
    assert moving or pushed > 0


def test_only_rolling_of_the_root_is_damped_in_the_world():
    rope = RopeConfig(root="middle")
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
def test_points_that_are_no_shape_of_the_rope_are_refused(damage, message):
    rope = RopeConfig()
    with pytest.raises(ShapeError, match=message):
        check_points(damage(straight(rope)), rope)


@pytest.mark.parametrize(
    "wrong", [{"links": 2}, {"length": 0.0}, {"radius": -1.0}, {"root": "tail"}]
)
def test_impossible_ropes_are_refused(wrong):
    with pytest.raises(ValueError, match="rope"):
        replace(RopeConfig(), **wrong)

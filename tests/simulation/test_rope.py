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


@pytest.mark.parametrize("links", [8, 40, 61])
@pytest.mark.parametrize("make", [random_curve, spatial_curve])
def test_posed_rope_has_the_given_vertices(links, make, rng):
    rope = RopeConfig(links=links)
    model = build_model(rope)
    points = np.stack([make(rope, rng) for _ in range(5)])
    for given, qpos in zip(points, pose(points, rope), strict=True):
        np.testing.assert_allclose(vertices(model, qpos), given, atol=1e-6)


def test_a_rope_that_heads_backwards_and_up_is_posed(rng):
    rope = RopeConfig(links=8)
    points = straight(rope) @ np.diag([-1.0, 1, 1]) + [0, 0, 0.1]
    points[:, 2] += np.linspace(0, 0.0, 9)
    np.testing.assert_allclose(
        vertices(build_model(rope), pose(points[None], rope)[0]), points, atol=1e-6
    )


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


@pytest.mark.parametrize("wrong", [{"links": 2}, {"length": 0.0}, {"radius": -1.0}])
def test_impossible_ropes_are_refused(wrong):
    with pytest.raises(ValueError, match="rope"):
        replace(RopeConfig(), **wrong)

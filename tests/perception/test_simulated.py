"""The simulated camera against geometry worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotflow.perception import Appearance, Camera, CameraNoiseConfig, Label, SimulatedCamera
from knotflow.perception.camera.simulated import TAPE
from knotflow.simulation import RopeConfig, ShapeError, random_curve, straight

ROPE = RopeConfig(radius=0.008)


def test_a_flat_table_has_the_depth_of_its_plane(camera, simulated):
    far = straight(ROPE) + [5.0, 5.0, 0.0]
    view = simulated.view(far)
    assert (view.labels == Label.TABLE).all()
    np.testing.assert_allclose(view.image.depth, 1.2, atol=1e-6)

    tilted = replace(camera, rotation=Rotation.from_euler("x", 150, degrees=True).as_matrix())
    depth = SimulatedCamera(tilted, ROPE).view(far).image.depth
    rays = tilted.rays()
    distance = -tilted.position[2] / rays[..., 2]
    np.testing.assert_allclose(depth, distance * (rays @ tilted.rotation[:, 2]), rtol=1e-5)


def test_a_straight_rope_has_the_depth_of_its_cylinder(camera, simulated):
    height = 0.1
    view = simulated.view(straight(ROPE) + [0.0, 0.05, height - ROPE.radius])
    rays, middle = camera.rays(), np.array([0.05, height]) - camera.position[1:]  # y and z
    columns = np.abs(camera.project(np.array([0.45, 0.05, height]))[0] - camera.cx)
    inside = np.abs(np.arange(camera.width) - camera.cx) < columns  # away from the round ends
    # |t d - m|^2 = r^2 in the plane across the rope
    across = rays[..., 1:]
    squared, along = (across**2).sum(-1), across @ middle
    root = along**2 - squared * (middle @ middle - ROPE.radius**2)
    hit = (root > 0) & inside
    np.testing.assert_array_equal((view.labels == Label.ROPE)[:, inside], hit[:, inside])
    distance = (along[hit] - np.sqrt(root[hit])) / squared[hit]
    expected = distance * (rays[hit] @ camera.rotation[:, 2])
    np.testing.assert_allclose(view.image.depth[hit], expected, atol=1e-5)


def test_a_rope_is_seen_where_the_camera_projects_it(camera, simulated, rng):
    points = random_curve(ROPE, rng)
    u, v, _ = camera.project(points).T
    labels = simulated.view(points).labels
    assert (labels[np.rint(v).astype(int), np.rint(u).astype(int)] == Label.ROPE).all()


@pytest.mark.slow
def test_ray_window_changes_nothing(camera, rng, monkeypatch):
    """An image is the same whether or not its other rays are cast."""
    turned = Rotation.from_euler("xyz", [150, 20, 40], degrees=True).as_matrix()
    near = replace(camera, position=np.array([0.1, 0.0, 0.25]))
    for eye in (camera, replace(camera, rotation=turned, position=np.array([0.2, 0.4, 0.9])), near):
        for gripper in (None, [0.3, 0.1, 0.05]):
            points = random_curve(ROPE, rng) + [0.2, 0.0, 0.0]
            part = SimulatedCamera(eye, ROPE).view(points, gripper)
            with monkeypatch.context() as patch:
                patch.setattr(SimulatedCamera, "_window", lambda *_: (slice(None), slice(None)))
                whole = SimulatedCamera(eye, ROPE).view(points, gripper)
            np.testing.assert_array_equal(part.labels, whole.labels)
            np.testing.assert_array_equal(part.image.rgb, whole.image.rgb)
            np.testing.assert_array_equal(part.image.depth, whole.image.depth)


def test_the_upper_strand_hides_the_lower(camera, simulated, overhand):
    links = 0.5 * (overhand[1:] + overhand[:-1])
    u, v, depth = camera.project(links).T
    seen = simulated.view(overhand).image.depth[np.rint(v).astype(int), np.rint(u).astype(int)]
    assert (seen < depth - 0.3 * ROPE.radius).all()  # never deeper than the strand's own surface
    assert (seen < depth - 2 * ROPE.radius).sum() >= 3  # nearer where another one is above


def test_the_gripper_hides_the_rope_it_holds(simulated, overhand):
    free = simulated.view(overhand)
    held = simulated.view(overhand, gripper=overhand[20])
    hidden = (free.labels == Label.ROPE) & (held.labels == Label.GRIPPER)
    assert hidden.sum() > 20
    assert (held.image.depth[hidden] < free.image.depth[hidden]).all()
    same = held.labels != Label.GRIPPER
    np.testing.assert_array_equal(held.image.depth[same], free.image.depth[same])


def test_the_gripper_has_two_fingers_across_the_rope():
    """Seen from below, where nothing else hides them."""
    up = np.diag([1.0, 1.0, 1.0])
    below = Camera(200, 200, 200.0, 200.0, 99.5, 99.5, np.array([0.0, 0.0, 0.1]), up)
    simulated = SimulatedCamera(below, ROPE)
    points = straight(ROPE) + [0.0, 0.0, 0.3]
    for closed, gap in ((True, 2 * ROPE.radius), (False, 0.05)):
        labels = simulated.view(points, gripper=[0.0, 0.0, 0.308], closed=closed).labels
        tips = 0.3 - below.position[2]  # depth of the fingertips
        for side in (-1, 1):
            inner = below.cy + side * 200.0 * (gap / 2 + 0.002) / tips
            outer = below.cy + side * 200.0 * (gap / 2 + 0.006) / tips
            column = labels[np.rint([inner, outer]).astype(int), 100]
            assert (column == Label.GRIPPER).all()
        assert labels[100, 100] == Label.ROPE


def test_the_head_alone_is_coloured(camera, overhand):
    look = replace(Appearance(), head=TAPE, ambient=1.0)
    view = SimulatedCamera(camera, ROPE, appearance=look).view(overhand)
    red = (view.image.rgb == np.rint(255 * np.array(TAPE))).all(axis=-1)
    u, v, _ = camera.project(overhand[:2]).T
    assert red[np.rint(v).astype(int), np.rint(u).astype(int)].all()
    rows, columns = np.nonzero(red)
    assert np.hypot(rows - v[0], columns - u[0]).max() < 0.06 * camera.fx / 1.15


def test_an_image_is_the_same_for_the_same_generator(camera, overhand):
    def capture(seed):
        rng, noise = np.random.default_rng(seed), CameraNoiseConfig()
        look = Appearance.draw(rng, noise)
        return SimulatedCamera(camera, ROPE, noise, look).capture(overhand, rng, overhand[5])

    one, same, other = capture(3), capture(3), capture(4)
    np.testing.assert_array_equal(one.rgb, same.rgb)
    np.testing.assert_array_equal(one.depth, same.depth)
    assert (one.rgb != other.rgb).any() and (one.depth != other.depth).any()


def test_drawn_colours_have_contrast(rng):
    for level in (1, 2):
        noise = CameraNoiseConfig(level=level)
        for _ in range(50):
            look = Appearance.draw(rng, noise)
            apart = [np.subtract(look.rope, look.table), np.subtract(look.rope, look.head)]
            assert min(np.linalg.norm(apart, axis=1)) >= noise.contrast / level
    assert Appearance.draw(rng, CameraNoiseConfig(coloured_head=False)).head is None


def test_points_of_another_rope_raise(simulated, overhand):
    with pytest.raises(ShapeError):
        simulated.view(overhand[:-1])

"""The twin does to a rope what a gripper does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotflow.execution import ERROR_LEVELS, Twin, TwinConfig
from knotflow.execution.twin import displace_camera
from knotflow.perception import Camera
from knotflow.simulation import LEVELS

UP = np.array([0.0, 0.0, 0.05])


def centre(points, link):
    return (points[link] + points[link + 1]) / 2


def twin_of(points, level=0, seed=3, **config):
    return Twin(points, TwinConfig(level=level, **config), np.random.default_rng(seed))


def holding(points, off=(0.0, 0.0, 0.0), **config):
    """A twin whose fingers closed so far from the centre of link 20, metres."""
    twin = twin_of(points, **config)
    twin.move_to(centre(twin.points, 20) + off, 0.5)
    twin.grasp()
    return twin


def test_the_rope_goes_on_while_an_image_is_worked_on(plan):
    camera = Camera.overhead()
    quick, slow = (
        Twin(plan.start, TwinConfig(level=0, compute_time=time), np.random.default_rng(1), camera)
        for time in (0.0, 0.5)
    )
    for twin in (quick, slow):
        twin.observe(), twin.move_to(np.array([0.0, 0.0, 0.2]), 0.1)
    assert slow.times[0] - quick.times[0] == pytest.approx(0.5)


def test_draws_do_not_depend_on_commands(points):
    one, other = twin_of(points, level=2), twin_of(points, level=2)
    one.robot().move_to(UP, 1.0)
    other.grasp()
    other.release()
    other.robot().move_to(UP, 1.0)
    assert one.rope == other.rope
    np.testing.assert_array_equal(one.position, other.position)


@pytest.mark.parametrize("level", LEVELS)
def test_grasped_link_lifts_the_rope(points, level):
    robot = (twin := holding(points, level=level, reach=0.05)).robot()
    assert twin.grasped
    robot.move_to(centre(twin.points, 20) + UP, 1.0)
    heights = twin.points[:, 2]
    assert heights[20:22].max() > 0.03 + heights[0]
    robot.release()
    robot.move_to(UP * 4, 1.0)
    assert twin.points[:, 2].max() < 0.8 * heights.max()


def test_a_link_is_held_as_far_from_the_fingers_as_it_was_caught(points):
    robot = (twin := holding(points, (0.0, 0.008, 0.0))).robot()
    caught = centre(twin.points, 20) - robot.position
    robot.move_to(robot.position + UP, 1.0)
    held = centre(twin.points, 20) - robot.position
    assert caught[1] == pytest.approx(-0.008, abs=1e-3)
    np.testing.assert_allclose(held, caught, atol=3e-3)


def test_errors_of_gripper_and_camera_are_of_the_levels_size(points):
    camera = Camera.overhead()
    for level, errors in zip(LEVELS, ERROR_LEVELS, strict=True):
        twin, places = twin_of(points, level=level), []
        for _ in range(200):
            twin.move_to(UP, 0.5)
            places.append(twin.position - UP)
        assert np.std(np.array(places)[:, :2]) == pytest.approx(errors.actuation, rel=0.2)
        np.testing.assert_allclose(np.array(places)[:, 2], 0.0, atol=1e-12)
        seen = displace_camera(camera, errors, np.random.default_rng(level))
        shift = np.abs(seen.position - camera.position).max()
        turn = Rotation.from_matrix(seen.rotation @ camera.rotation.T).magnitude()
        assert (shift > 0) == (turn > 0) == (level > 0)
        assert shift <= errors.camera_shift and turn <= np.sqrt(3) * errors.camera_turn + 1e-9


def test_fingers_close_with_an_error_of_their_own(points):
    twin = twin_of(points, level=2, reach=0.005)
    twin.move_to(centre(points, 20), 0.5)
    for _ in range(40):
        twin.grasp()
    assert 0 < twin.missed_grasps < 40


def test_a_rope_that_is_held_still_falls_when_released(points):
    robot = (twin := holding(points)).robot()
    robot.move_to(centre(points, 20) + UP, 1.0)
    robot.move_to(robot.position, 3.0)
    assert twin.points[20:22, 2].min() > 0.04
    robot.release()
    robot.move_to(UP * 4, 1.0)
    assert twin.points[:, 2].max() < 0.02


def test_a_held_link_is_not_pressed_into_the_table(points):
    robot = (twin := holding(points)).robot()
    robot.move_to(robot.position - UP, 1.0)
    assert twin.points[20:22, 2].min() > 0.8 * twin.rope.radius


def test_missed_grasp_holds_nothing(points):
    twin = twin_of(points)
    robot = twin.robot()
    before = twin.points
    robot.move_to(centre(points, 20) + [0.0, 0.03, 0.0], 0.5)
    robot.grasp()
    assert not twin.grasped and twin.missed_grasps == 1
    robot.move_to(robot.position + UP, 0.5)
    np.testing.assert_allclose(twin.points, before, atol=1e-3)


def test_free_rope_lies_still(points):
    twin = twin_of(points, level=2)
    before = twin.points
    for _ in range(20):
        twin.move_to(UP, 0.5)
    np.testing.assert_array_equal(twin.points, before)


def test_rope_settles_on_the_table(points):
    assert twin_of(points + UP).points[:, 2].max() < 0.02


def test_robot_error_grows_with_the_level(points):
    exact, swaying = twin_of(points, level=0), twin_of(points, level=2)
    for twin in (exact, swaying):
        twin.move_to(UP, 1.3)
    np.testing.assert_allclose(exact.position, UP, atol=1e-9)
    assert 0 < np.linalg.norm(swaying.position - UP) < 0.06


def test_images_need_a_camera(points):
    twin = twin_of(points)
    with pytest.raises(RuntimeError, match="camera"):
        twin.robot().observe()
    camera = Camera.overhead(80, 60)
    seeing = Twin(points, TwinConfig(level=1), np.random.default_rng(0), camera)
    seeing.robot().move_to(UP, 0.1)
    image = seeing.robot().observe()
    assert image.depth.shape == (60, 80)
    assert np.nanmedian(image.depth) == pytest.approx(camera.position[2], abs=0.02)


def test_invalid_commands_are_refused(points):
    with pytest.raises(ValueError, match="position"):
        twin_of(points).robot().move_to([0.0, np.nan, 0.1], 0.1)
    with pytest.raises(ValueError, match="level"):
        twin_of(points, level=4)

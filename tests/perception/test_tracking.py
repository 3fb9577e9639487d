"""The tracker, its prediction at constant velocity, and coherent point drift."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.perception import (
    EstimateConfig,
    FitConfig,
    RgbdImage,
    SearchConfig,
    TraceError,
    Tracker,
    TrackerConfig,
    tracking,
)
from knotflow.perception.estimation.fitting import project_lengths
from knotflow.perception.tracking import CpdTracker, constant_velocity, drift

from .shapes import CAMERA, ROPE, image, s_curve

QUICK = TrackerConfig(
    estimate=EstimateConfig(
        FitConfig(steps=25), search=SearchConfig(guesses=1, rounds=0), fallback_search=None
    )
)
LINK = 20


def error(found, points):
    return float(np.linalg.norm(found.points - points, axis=1).mean())


def at(points, seconds):
    return replace(image(points), time=seconds)


def bare():
    """An image of the table alone."""
    seen = image(s_curve())
    depth = np.full_like(seen.depth, CAMERA.position[2])
    return RgbdImage(np.full_like(seen.rgb, 60), depth)


def test_track_dragged_rope():
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points)
    for frame in range(4):
        moved = points + [0.0, 0.02 * frame, 0.0]
        gripper = moved[LINK : LINK + 2].mean(axis=0)
        found = tracker.update(at(moved, 0.1 * frame), gripper, LINK)
        assert error(found, moved) < 6e-3
        assert found.visible.mean() > 0.8 and not any(
            "lost" in doubt for doubt in found.ambiguities
        )


def test_hidden_vertices_follow_prediction():
    points, shift = s_curve(), np.array([0.0, 0.02, 0.0])
    seen = image(points + shift)
    seen.depth[:, CAMERA.width // 2 :] = np.nan
    tracker = Tracker(CAMERA, ROPE, points, QUICK, predict=lambda now, *_: now + shift)
    found = tracker.update(seen)
    assert not found.visible[-8:].any() and found.visible[:15].all()
    assert np.linalg.norm(found.points - points - shift, axis=1)[-8:].max() < 8e-3


def test_lost_track_is_reported(monkeypatch):
    asked = []

    def in_vain(*arguments, **named):
        asked.append(arguments)
        raise TraceError("no rope")

    monkeypatch.setattr(tracking, "estimate", in_vain)
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points - [0, 0.3, 0], replace(QUICK, patience=2))
    for _ in range(3):
        found = tracker.update(image(points))
        assert found.ambiguities[0] == "the track is lost" and found.coverage_fraction < 0.8
    assert len(asked) == 2  # at once, and when patience is over


@pytest.mark.slow
def test_reacquisition_preserves_head():
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points - [0, 0.3, 0], QUICK)
    found = tracker.update(image(points))
    assert found.ambiguities[0].startswith("the track was lost")
    assert error(found, points) < 6e-3
    assert error(tracker.update(image(points)), points) < 6e-3


def test_bare_table_is_a_lost_track():
    points = s_curve()
    found = Tracker(CAMERA, ROPE, points, QUICK).update(bare())
    assert found.ambiguities[0] == "the track is lost"
    assert not found.visible.any()


@pytest.mark.slow
def test_look_preserves_head():
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points + [0, 0.004, 0], QUICK)
    found = tracker.look(image(points))
    assert found.head_known and error(found, points) < 4e-3
    assert np.array_equal(tracker.points, found.points)


@pytest.mark.parametrize(
    ("gripper", "grasped", "message"),
    [
        (np.zeros(3), 40, "0 to 39"),
        (None, 3, "needs the gripper's place"),
        (np.array([0.0, np.nan, 0.0]), 3, "needs the gripper's place"),
    ],
)
def test_invalid_grasp_raises(gripper, grasped, message):
    points = s_curve()
    with pytest.raises(ValueError, match=message):
        Tracker(CAMERA, ROPE, points).update(image(points), gripper, grasped)


def test_invalid_initial_shape_raises():
    with pytest.raises(ValueError, match=r"points \(41, 3\)"):
        Tracker(CAMERA, ROPE, s_curve()[:-1])


def test_model_receives_gripper_position():
    points, told = s_curve(), []

    def predict(now, velocities, seconds, gripper, grasped):
        told.append((gripper, grasped))
        return now

    tracker = Tracker(CAMERA, ROPE, points, QUICK, predict)
    ahead = points[LINK : LINK + 2].mean(axis=0) + [0.01, 0.0, 0.0]  # its link trails by 1 cm
    for frame in range(2):
        tracker.update(at(points, 0.1 * frame), ahead, LINK)
    tracker.update(at(points, 0.2), ahead)
    assert all(np.array_equal(gripper, ahead) and link == LINK for gripper, link in told[:2])
    assert told[2] == (None, None)


@pytest.mark.slow
def test_look_recovers_lost_rope():
    points = s_curve()
    astray = points.copy()
    astray[25:, 1] += np.linspace(0.0, 0.12, 16)
    tracker = Tracker(CAMERA, ROPE, astray, QUICK)
    found = tracker.look(image(points))
    assert found.coverage_fraction > 0.98 and error(found, points) < 4e-3
    assert np.array_equal(tracker.points, found.points)
    with pytest.raises(TraceError):
        tracker.look(bare())


HELD = 12


def lengths(points):
    return np.linalg.norm(np.diff(points, axis=0), axis=1)


def test_released_rope_stays():
    points = s_curve()
    assert np.array_equal(constant_velocity(points, np.ones_like(points), 0.1, None, None), points)


def test_still_gripper_moves_nothing():
    points = s_curve()
    gripper = points[HELD : HELD + 2].mean(axis=0)
    still = constant_velocity(points, np.zeros_like(points), 0.1, gripper, HELD)
    assert np.allclose(still, points, atol=1e-9)


def test_held_link_follows_gripper():
    points = s_curve()
    gripper = points[HELD : HELD + 2].mean(axis=0) + [0.03, 0.06, 0.05]
    moved = constant_velocity(points, np.zeros_like(points), 0.1, gripper, HELD)
    assert np.linalg.norm(moved[HELD : HELD + 2].mean(axis=0) - gripper) < 2e-3
    assert np.allclose(lengths(moved), ROPE.link_length, rtol=1e-6)


def test_velocity_is_limited_in_time():
    points, velocity = s_curve(), np.array([0.1, 0.0, 0.0])
    gripper = points[HELD : HELD + 2].mean(axis=0)
    moved = constant_velocity(points, velocity + 0 * points, 0.1, gripper + 0.1 * velocity, HELD)
    assert np.allclose(moved - points, 0.1 * velocity, atol=1e-9)
    later = constant_velocity(points, velocity + 0 * points, 5.0, gripper, HELD)
    assert np.linalg.norm(later - points, axis=1).max() < 0.03


def test_an_immovable_vertex_stays():
    points = s_curve()
    stretched = points * [1.05, 1.0, 1.0]
    mobility = np.ones(len(points))
    mobility[5] = 1e-6
    shape = project_lengths(stretched, ROPE.link_length, mobility)
    assert np.linalg.norm(shape[5] - stretched[5]) < 1e-5
    assert lengths(shape) == pytest.approx(ROPE.link_length, rel=1e-6)


def test_drift_recovers_translation():
    points = s_curve()
    found = drift(points - [0.0, 0.015, 0.0], points, ROPE)
    assert np.linalg.norm(found - points, axis=1).mean() < 4e-3
    assert np.allclose(np.linalg.norm(np.diff(found, axis=0), axis=1), ROPE.link_length, rtol=1e-5)


def test_hidden_vertices_follow_visible_ones():
    points = s_curve()
    shift = np.array([0.0, 0.015, 0.0])
    shown = np.r_[points[:17], points[24:]]
    found = drift(points - shift, shown, ROPE)
    assert (found - points + shift)[17:24, 1].mean() > 0.6 * shift[1]


def test_update_tracks_rope_in_image():
    points = s_curve()
    tracker = CpdTracker(CAMERA, ROPE, points - [0.0, 0.012, 0.0])
    found = tracker.update(image(points))
    assert np.linalg.norm(found.points - points, axis=1).mean() < 6e-3
    assert found.coverage_fraction > 0.7

"""A rope is followed from image to image, and a tracker that lost it says so."""

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
)
from knotflow.perception.tracking import tracker as tracking

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


def test_a_dragged_rope_is_followed():
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


def test_hidden_vertices_move_by_the_prediction():
    points, shift = s_curve(), np.array([0.0, 0.02, 0.0])
    seen = image(points + shift)
    seen.depth[:, CAMERA.width // 2 :] = np.nan
    tracker = Tracker(CAMERA, ROPE, points, QUICK, predict=lambda now, *_: now + shift)
    found = tracker.update(seen)
    assert not found.visible[-8:].any() and found.visible[:15].all()
    assert np.linalg.norm(found.points - points - shift, axis=1)[-8:].max() < 8e-3


def test_a_rope_that_jumped_and_is_not_found_is_said_to_be_lost(monkeypatch):
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
def test_a_lost_rope_is_found_again_its_head_where_it_was_nearest():
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points - [0, 0.3, 0], QUICK)
    found = tracker.update(image(points))
    assert found.ambiguities[0].startswith("the track was lost")
    assert error(found, points) < 6e-3
    assert error(tracker.update(image(points)), points) < 6e-3


def test_a_table_without_rope_is_a_lost_track_not_a_rope():
    points = s_curve()
    found = Tracker(CAMERA, ROPE, points, QUICK).update(bare())
    assert found.ambiguities[0] == "the track is lost"
    assert not found.visible.any()


@pytest.mark.slow
def test_a_look_at_the_rope_at_rest_keeps_head_and_shape():
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
def test_what_holds_the_rope_has_to_make_sense(gripper, grasped, message):
    points = s_curve()
    with pytest.raises(ValueError, match=message):
        Tracker(CAMERA, ROPE, points).update(image(points), gripper, grasped)


def test_a_track_begins_with_a_shape_of_the_rope():
    with pytest.raises(ValueError, match=r"points \(41, 3\)"):
        Tracker(CAMERA, ROPE, s_curve()[:-1])


def test_a_model_is_told_where_the_gripper_is_and_not_where_its_link_trails():
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
def test_at_rest_a_rope_is_found_that_was_tracked_elsewhere():
    points = s_curve()
    astray = points.copy()
    astray[25:, 1] += np.linspace(0.0, 0.12, 16)
    tracker = Tracker(CAMERA, ROPE, astray, QUICK)
    found = tracker.look(image(points))
    assert found.coverage_fraction > 0.98 and error(found, points) < 4e-3
    assert np.array_equal(tracker.points, found.points)
    with pytest.raises(TraceError):
        tracker.look(bare())

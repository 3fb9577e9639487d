"""The tracker follows what moves, and says what it lost."""

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

from .shapes import CAMERA, ROPE, image, s_curve

QUICK = TrackerConfig(
    estimate=EstimateConfig(
        FitConfig(steps=25), search=SearchConfig(guesses=1, rounds=0), fallback_search=None
    )
)
LINK = 20


def still(points, *_):
    """Predicts a rope that stays."""
    return points


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
    tracker = Tracker(CAMERA, ROPE, points, lambda now, speed, seconds, *_: now + seconds * speed)
    for frame in range(4):
        moved = points + [0.0, 0.02 * frame, 0.0]
        gripper = moved[LINK : LINK + 2].mean(axis=0)
        found = tracker.update(at(moved, 0.1 * frame), gripper, LINK)
        assert error(found, moved) < 6e-3
        assert found.visible.mean() > 0.8 and not any(
            "lost" in doubt for doubt in found.ambiguities
        )


def test_more_steps_follow_a_rope_that_few_do_not(monkeypatch):
    monkeypatch.delattr(tracking, "estimate")  # and no search is needed
    monkeypatch.setattr(tracking, "register", lambda predicted, *_: predicted)
    points, moved = s_curve(), s_curve() + [0.0, 0.025, 0.0]
    few = TrackerConfig(lost=0.0)
    assert Tracker(CAMERA, ROPE, points, still, few).update(image(moved)).coverage_fraction < 0.8
    found = Tracker(CAMERA, ROPE, points, still).update(image(moved))
    assert found.coverage_fraction > 0.9 and error(found, moved) < 6e-3


def test_image_beyond_the_prediction_is_seen_where_the_rope_reaches_there(monkeypatch):
    seen, observed = [], tracking.observe

    def observe(image, *arguments):
        seen.append(image.depth.shape)
        return observed(image, *arguments)

    monkeypatch.setattr(tracking, "observe", observe)
    points = s_curve() * [0.5, 0.5, 1]
    for moved in (0.0, 0.14):
        Tracker(CAMERA, ROPE, points, still, QUICK).update(image(points + [moved, 0, 0]))
    near, again, whole = seen
    assert near == again != whole == (CAMERA.height, CAMERA.width)


@pytest.mark.parametrize("aside", [[2.0, 0, 0], [-2.0, 0, 0], [0, 2.0, 0], [0, -2.0, 0]])
def test_prediction_beyond_the_image_does_not_lose_the_rope(aside):
    tracker = Tracker(CAMERA, ROPE, s_curve(), lambda now, *_: now + aside, QUICK)
    assert error(tracker.update(image(s_curve())), s_curve()) < 6e-3


def test_hidden_vertices_follow_prediction():
    points, shift = s_curve(), np.array([0.0, 0.02, 0.0])
    seen = image(points + shift)
    seen.depth[:, CAMERA.width // 2 :] = np.nan
    tracker = Tracker(CAMERA, ROPE, points, lambda now, *_: now + shift, QUICK)
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
    tracker = Tracker(CAMERA, ROPE, points - [0, 0.3, 0], still, replace(QUICK, patience=2))
    for _ in range(3):
        found = tracker.update(image(points))
        assert found.ambiguities[0] == "the track is lost" and found.coverage_fraction < 0.8
    assert len(asked) == 2  # at once, and when patience is over


@pytest.mark.slow
def test_reacquisition_preserves_head():
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points - [0, 0.3, 0], still, QUICK)
    found = tracker.update(image(points))
    assert found.ambiguities[0].startswith("the track was lost")
    assert error(found, points) < 6e-3
    assert error(tracker.update(image(points)), points) < 6e-3


def test_bare_table_is_a_lost_track():
    points = s_curve()
    found = Tracker(CAMERA, ROPE, points, still, QUICK).update(bare())
    assert found.ambiguities[0] == "the track is lost"
    assert not found.visible.any()


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
        Tracker(CAMERA, ROPE, points, still).update(image(points), gripper, grasped)


def test_invalid_initial_shape_raises():
    with pytest.raises(ValueError, match=r"points \(41, 3\)"):
        Tracker(CAMERA, ROPE, s_curve()[:-1], still)


def test_the_held_link_stays_where_it_was_caught():
    points = s_curve()
    tracker = Tracker(CAMERA, ROPE, points, still, QUICK)
    place = points[LINK : LINK + 2].mean(axis=0)
    tracker.update(at(points, 0.0), place, LINK)
    for frame in range(1, 6):  # the image shows the rope sliding through the fingers
        slid = points + [0.0, 0.004 * frame, 0.0]
        tracker.update(at(slid, 0.1 * frame), place, LINK)
    assert np.linalg.norm(tracker._held_place(place, LINK) - place) < 0.003


def test_model_receives_gripper_position():
    points, told = s_curve(), []

    def predict(now, velocities, seconds, gripper, grasped):
        told.append((gripper, grasped))
        return now

    tracker = Tracker(CAMERA, ROPE, points, predict, QUICK)
    ahead = points[LINK : LINK + 2].mean(axis=0) + [0.01, 0.0, 0.0]  # its link trails by 1 cm
    for frame in range(2):
        tracker.update(at(points, 0.1 * frame), ahead, LINK)
    tracker.update(at(points, 0.2), ahead)
    assert all(np.array_equal(gripper, ahead) and link == LINK for gripper, link in told[:2])
    assert told[2] == (None, None)

"""What a camera does not show is never made up."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.execution import (
    STEP,
    ExecutionConfig,
    ImageStateEstimator,
    Observation,
    TrackedRope,
    execute,
)
from knotflow.execution.robot import RobotError
from knotflow.execution.step_executor import StepExecutor
from knotflow.perception import Camera, RgbdImage, RopeEstimate, Tracker, TrackerConfig
from knotflow.simulation import RopeConfig, straight
from knotflow.topology import TopologicalState

CAMERA = Camera.overhead(80, 60)
STRAIGHT = straight(RopeConfig())
SEEN = RopeEstimate(
    points=STRAIGHT,
    visible=np.ones(41, bool),
    state=TopologicalState.trivial(),
    crossings=(),
    coverage_fraction=1.0,
    head_known=True,
    ambiguities=(),
)


class Filmed:
    """A robot whose camera shows a table, and loses the frames of some seconds."""

    def __init__(self, lost=(0.0, 0.0), silent=True):
        self.lost, self.silent, self.time, self.words = lost, silent, 0.0, []
        self.position = np.array([0.0, 0.0, 0.3])

    def observe(self):
        time = self.time
        if self.lost[0] <= time < self.lost[1]:
            if self.silent:
                raise TimeoutError("no frame")
            time = self.lost[0]
        depth = np.full((60, 80), CAMERA.position[2], np.float32)
        return RgbdImage(np.full((60, 80, 3), 120, np.uint8), depth, time)

    def move_to(self, position, seconds):
        self.time += seconds
        self.position = np.array(position)

    def grasp(self):
        self.words.append("grasp")

    def release(self):
        self.words.append("release")


def test_unreadable_shape_is_ambiguous():
    assert Observation.of(STRAIGHT).ambiguities == ()
    upright = Observation.of(STRAIGHT[:, ::-1])
    assert upright.state is None and upright.ambiguities


def test_empty_table_shows_no_rope(plan):
    robot = Filmed()
    execution = execute(
        plan, robot, estimator=ImageStateEstimator(CAMERA), replan=lambda points: plan
    )
    assert execution.tied is False and execution.outcomes == ()
    assert execution.reason.startswith("the rope is not seen: ")
    assert "grasp" not in robot.words


@pytest.mark.parametrize("silent", [True, False])
def test_lost_frames_are_waited_for(silent, monkeypatch):
    asked = []

    def estimate(image, camera, rope, **_):
        asked.append(image.time)
        return SEEN

    monkeypatch.setattr("knotflow.perception.estimate", estimate)
    robot, estimator = Filmed((0.0, 4.0), silent), ImageStateEstimator(CAMERA)
    run = StepExecutor(robot, ExecutionConfig(image_timeout=10.0))
    observation = run.observe(estimator, 0)
    assert observation.state == TopologicalState.trivial() and not observation.ambiguities
    assert len(asked) == 1 and asked[0] >= 4.0
    run = StepExecutor(Filmed((0.0, 1e3), silent), ExecutionConfig(image_timeout=1.0))
    observation = run.observe(ImageStateEstimator(CAMERA), 0)
    assert observation.points is None and observation.ambiguities == ("no new image came for 1 s",)
    assert run.moves[-1].gripper.tolist() == list(run.config.park_position)


def test_image_from_before_the_observation_is_skipped(monkeypatch):
    monkeypatch.setattr("knotflow.perception.estimate", lambda *_, **__: SEEN)
    robot, estimator = Filmed(), ImageStateEstimator(CAMERA)
    assert estimator.estimate(robot) is None  # it may be an old one
    assert estimator.estimate(robot) is None  # it is the same one
    robot.move_to(robot.position, STEP)
    assert estimator.estimate(robot) is not None
    assert estimator.estimate(robot) is None


def test_after_lost_frames_the_first_image_is_skipped_again(monkeypatch):
    monkeypatch.setattr("knotflow.perception.estimate", lambda *_, **__: SEEN)
    robot, estimator = Filmed(), ImageStateEstimator(CAMERA)
    assert estimator.estimate(robot) is None
    with monkeypatch.context() as lost:
        lost.setattr(robot, "lost", (0.0, 1.0))
        assert estimator.estimate(robot) is None
    robot.move_to(robot.position, STEP)
    assert estimator.estimate(robot) is None  # it may be of the look before
    robot.move_to(robot.position, STEP)
    assert estimator.estimate(robot) is not None


def test_likely_shapes_have_the_links_of_the_rope_that_is_looked_for(monkeypatch):
    asked = {}
    monkeypatch.setattr(
        "knotflow.perception.estimate", lambda *_, **named: asked.update(named) or SEEN
    )
    robot, estimator = Filmed(), ImageStateEstimator(CAMERA)
    estimator.estimate(robot)
    robot.move_to(robot.position, STEP)
    estimator.estimate(robot, [STRAIGHT[::2], STRAIGHT])
    assert [len(one) for one in asked["likely"]] == [len(STRAIGHT)] * 2
    assert len(asked["earlier"]) == len(STRAIGHT)


def test_unknown_head_is_ambiguous(monkeypatch):
    monkeypatch.setattr(
        "knotflow.perception.estimate", lambda *_, **__: replace(SEEN, head_known=False)
    )
    robot, estimator = Filmed(), ImageStateEstimator(CAMERA)
    estimator.estimate(robot)
    robot.move_to(robot.position, STEP)
    assert estimator.estimate(robot).ambiguities == ("head and tail look alike",)


def test_estimate_starts_at_likely_shapes_and_resets_the_tracker(monkeypatch):
    asked = {}
    monkeypatch.setattr(
        "knotflow.perception.estimate", lambda *_, **named: asked.update(named) or SEEN
    )
    robot, shifted = Filmed(), STRAIGHT + [0.0, 0.1, 0.0]
    tracker = Tracker(CAMERA, RopeConfig(), shifted, lambda points, *_: points)
    estimator = ImageStateEstimator(CAMERA, tracker=tracker)
    estimator.estimate(robot)
    robot.move_to(robot.position, STEP)
    estimator.estimate(robot, [STRAIGHT, STRAIGHT[::-1]])
    assert asked["earlier"] is STRAIGHT and len(asked["likely"]) == 2
    np.testing.assert_array_equal(tracker.points, SEEN.points)


def test_ambiguity_widens_the_next_search(monkeypatch):
    doubtful = replace(SEEN, ambiguities=("a crossing is in doubt",))
    tried, found = [], [doubtful, doubtful, doubtful, SEEN, SEEN]

    def estimate(*_, config, **__):
        tried.append(config.fallback_search is not None)
        return found.pop(0)

    monkeypatch.setattr("knotflow.perception.estimate", estimate)
    robot, estimator = Filmed(), ImageStateEstimator(CAMERA)
    for _ in range(10):
        estimator.estimate(robot, [STRAIGHT])
        robot.move_to(robot.position, STEP)
    assert tried == [False, True, False, True, False]


class Guess:
    """A tracker that says nothing moves, and takes down which link it is told is held."""

    config = TrackerConfig()

    def __init__(self):
        self.points, self.held = STRAIGHT, []

    def update(self, image, gripper, grasped):
        self.held.append(grasped)
        return SEEN


def test_nearest_link_is_held_until_release():
    tracker, robot = Guess(), Filmed((9.0, 10.0))
    source = TrackedRope(tracker)
    source.points(robot, False)
    robot.position = (STRAIGHT[7] + STRAIGHT[8]) / 2
    source.points(robot, True)
    robot.position = STRAIGHT[30]
    source.points(robot, True)
    source.points(robot, False)
    assert tracker.held == [None, 7, 7, None]
    robot.time = 9.5  # no image
    np.testing.assert_array_equal(source.points(robot, False), STRAIGHT)
    assert len(tracker.held) == 4


def test_images_of_another_size_are_not_the_cameras():
    estimator, robot = ImageStateEstimator(Camera.overhead(160, 120)), Filmed()
    estimator.estimate(robot)
    robot.time = 1.0
    with pytest.raises(RobotError, match="80x60 pixels, but the camera's are 160x120"):
        estimator.estimate(robot)


@pytest.mark.parametrize(("off", "refused"), [(0.03, False), (0.1, True)])
def test_a_camera_off_the_table_is_corrected_or_told(off, refused, monkeypatch):
    seen = []

    def estimate(image, camera, *args, **kwargs):
        seen.append(camera)
        return SEEN

    monkeypatch.setattr("knotflow.perception.estimate", estimate)
    position = CAMERA.position + [0.0, 0.0, off]
    estimator, robot = ImageStateEstimator(replace(CAMERA, position=position)), Filmed()
    estimator.estimate(robot)
    robot.time = 1.0
    found = estimator.estimate(robot)
    if refused:
        assert found.points is None and not seen
        assert "100 mm above z = 0" in found.ambiguities[0] and "pose" in found.ambiguities[0]
    else:
        np.testing.assert_allclose(seen[0].position, CAMERA.position, atol=1e-6)

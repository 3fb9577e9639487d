"""What a camera does not show is never made up."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.execution import STEP, Estimated, ExecutionConfig, Sight, Tracked, execute
from knotflow.execution.follow import Run
from knotflow.perception import Camera, RgbdImage, RopeEstimate, Tracker, TrackerConfig
from knotflow.simulation import RopeConfig, straight
from knotflow.topology import TopologicalState

CAMERA = Camera.overhead(80, 60)
STRAIGHT = straight(RopeConfig())
SEEN = RopeEstimate(
    points=STRAIGHT,
    seen=np.ones(41, bool),
    state=TopologicalState.trivial(),
    crossings=(),
    explained=1.0,
    spread=np.zeros(41),
    head_known=True,
    doubts=(),
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


def test_a_shape_that_cannot_be_read_is_in_doubt():
    assert Sight.of(STRAIGHT).doubts == ()
    upright = Sight.of(STRAIGHT[:, ::-1])
    assert upright.state is None and upright.doubts


def test_a_table_alone_shows_no_rope_and_no_knot(plan):
    robot = Filmed()
    execution = execute(plan, robot, look=Estimated(CAMERA), replan=lambda points: plan)
    assert execution.tied is False and execution.outcomes == ()
    assert execution.reason.startswith("the rope is not seen: ")
    assert "grasp" not in robot.words


@pytest.mark.parametrize("silent", [True, False])
def test_frames_that_are_lost_for_a_second_are_waited_for(silent, monkeypatch):
    asked = []

    def estimate(image, camera, rope, **_):
        asked.append(image.time)
        return SEEN

    monkeypatch.setattr("knotflow.perception.estimate", estimate)
    robot, look = Filmed((0.0, 4.0), silent), Estimated(CAMERA)
    run = Run(robot, ExecutionConfig(patience=10.0))
    sight = run.see(look, 0)
    assert sight.state == TopologicalState.trivial() and not sight.doubts
    assert len(asked) == 1 and asked[0] >= 4.0
    run = Run(Filmed((0.0, 1e3), silent), ExecutionConfig(patience=1.0))
    sight = run.see(Estimated(CAMERA), 0)
    assert sight.points is None and sight.doubts == ("no new image came for 1 s",)
    assert run.frames[-1].gripper.tolist() == list(run.config.aside)


def test_an_image_from_before_the_look_is_not_read(monkeypatch):
    monkeypatch.setattr("knotflow.perception.estimate", lambda *_, **__: SEEN)
    robot, look = Filmed(), Estimated(CAMERA)
    assert look.look(robot) is None  # it may be an old one
    assert look.look(robot) is None  # it is the same one
    robot.move_to(robot.position, STEP)
    assert look.look(robot) is not None
    assert look.look(robot) is None


def test_ends_that_look_alike_are_a_doubt(monkeypatch):
    monkeypatch.setattr(
        "knotflow.perception.estimate", lambda *_, **__: replace(SEEN, head_known=False)
    )
    robot, look = Filmed(), Estimated(CAMERA)
    look.look(robot)
    robot.move_to(robot.position, STEP)
    assert look.look(robot).doubts == ("head and tail look alike",)


def test_a_look_begins_where_the_rope_may_be_and_the_tracker_goes_on_from_it(monkeypatch):
    asked = {}
    monkeypatch.setattr(
        "knotflow.perception.estimate", lambda *_, **named: asked.update(named) or SEEN
    )
    robot, tracker = Filmed(), Tracker(CAMERA, RopeConfig(), STRAIGHT + [0.0, 0.1, 0.0])
    look = Estimated(CAMERA, tracker=tracker)
    look.look(robot)
    robot.move_to(robot.position, STEP)
    look.look(robot, [STRAIGHT, STRAIGHT[::-1]])
    assert asked["earlier"] is STRAIGHT and len(asked["likely"]) == 2
    np.testing.assert_array_equal(tracker.points, SEEN.points)


def test_after_a_doubt_it_is_searched_wider(monkeypatch):
    doubtful = replace(SEEN, doubts=("a crossing is in doubt",))
    tried, found = [], [doubtful, doubtful, doubtful, SEEN, SEEN]

    def estimate(*_, config, **__):
        tried.append(config.wider is not None)
        return found.pop(0)

    monkeypatch.setattr("knotflow.perception.estimate", estimate)
    robot, look = Filmed(), Estimated(CAMERA)
    for _ in range(10):
        look.look(robot, [STRAIGHT])
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


def test_the_link_that_fingers_close_on_is_held_until_they_open():
    tracker, robot = Guess(), Filmed((9.0, 10.0))
    source = Tracked(tracker)
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

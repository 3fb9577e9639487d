"""A run stops with a reason, and says that a knot is tied only where it is seen."""

import numpy as np
import pytest

from knotflow.apps import lab
from knotflow.execution import TrueState, Twin, TwinConfig
from knotflow.perception import Camera, RgbdImage
from knotflow.planning import PlannerConfig, plan_rope
from knotflow.recording import RunLog
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveLibrary
from knotflow.simulation import RopeConfig, straight

ROPE = RopeConfig()
LOOP = "R1(0,1,1)"


@pytest.fixture
def twin():
    return Twin(straight(ROPE), TwinConfig(level=0), np.random.default_rng(0))


@pytest.fixture
def start(tmp_path, twin, monkeypatch):
    """Ties a loop, with the twin's true state in place of vision, unless `blind`."""

    def tie(robot=None, confirm=lambda step, plan: True, blind=False, allow=None):
        if not blind:
            monkeypatch.setattr(lab, "ImageStateEstimator", lambda camera, rope: TrueState(twin))
        rng = np.random.default_rng(0)
        library = PrimitiveLibrary.load(SHIPPED_PRIMITIVES)

        def replan(points):
            config = PlannerConfig(batch=4, max_branches=200)
            return plan_rope(points, LOOP, rng, sampler=library, config=config)

        with RunLog(tmp_path / "run.mcap", {"knot": LOOP}) as log:
            robot = robot or twin.robot()
            camera = Camera.overhead()
            return lab.tie(LOOP, robot, camera, ROPE, replan, confirm, log, allow=allow)

    return tie


@pytest.mark.slow
def test_a_loop_is_tied_and_logged(start, twin, tmp_path):
    shown = []

    def confirm(step, plan):
        shown.append(str(step.action))
        return True

    done = start(confirm=confirm)
    assert done.tied and shown == [LOOP] and not twin.grasped
    assert done.reason == "the knot is seen to be tied after 1 actions"
    from mcap.reader import make_reader

    with (tmp_path / "run.mcap").open("rb") as file:
        counts: dict[str, int] = {}
        for _, channel, _ in make_reader(file).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert counts["/gripper"] == len(twin.times) >= len(done.execution.times)
    assert counts["/estimate"] == 2 and counts["/topology"] >= 3


def test_a_persons_no_stops_before_anything_is_grasped(start, twin):
    done = start(confirm=lambda step, plan: False)
    assert (done.tied, done.reason) == (False, "the next step was not allowed after 0 actions")
    assert done.execution.outcomes == ()


def test_nothing_moves_before_it_is_allowed(start, twin):
    told = []
    done = start(allow=told.append)
    assert (done.tied, done.execution) == (False, None)
    assert done.reason == "the gripper was not allowed to move out of the way"
    assert len(told) == 1 and "[0, 450, 300] mm" in told[0] and twin.times == []


class Faulty(lab.RobotWrapper):
    released = False

    def grasp(self):
        raise RuntimeError("motor 3 is off")

    def release(self):
        self.released = True


def test_a_fault_of_the_driver_ends_the_run_and_opens_the_fingers(start, twin):
    robot = Faulty(twin.robot())
    done = start(robot)
    assert not done.tied and "failed at grasp: RuntimeError('motor 3 is off')" in done.reason
    assert robot.released


class Blind(lab.RobotWrapper):
    def observe(self):
        raise TimeoutError("no frame")


def test_a_lost_camera_ends_the_run(start, twin):
    done = start(Blind(twin.robot()), blind=True)
    assert (done.tied, done.reason) == (False, "the rope is not seen: no new image came for 3 s")


def test_images_are_logged(twin, tmp_path):
    image = RgbdImage(np.zeros((4, 6, 3), np.uint8), np.ones((4, 6), np.float32), 0.0)

    class Seeing(lab.RobotWrapper):
        def observe(self):
            return image

    with RunLog(tmp_path / "run.mcap", {}) as log:
        assert lab.LoggedRobot(Seeing(twin.robot()), log).observe() is image
    assert (tmp_path / "run.mcap").read_bytes().count(b"/camera") > 0
    with pytest.raises(FileExistsError):
        RunLog(tmp_path / "run.mcap", {})


def test_a_driver_is_found_by_its_name(monkeypatch, tmp_path):
    (tmp_path / "my_robots.py").write_text("from tests_lab_arm import Arm\nclass Half: grasp = 1\n")
    (tmp_path / "tests_lab_arm.py").write_text(
        "class Arm:\n    position = 0\n    observe = move_to = grasp = release = print\n"
    )
    monkeypatch.chdir(tmp_path)
    assert type(lab.load_robot("my_robots:Arm")).__name__ == "Arm"
    for name, message in (
        ("my_robots", "write twin, or a driver as my_lab.robots:Arm"),
        ("my_robots:Leg", "has no attribute 'Leg'"),
        ("no_such_lab:Arm", "No module named 'no_such_lab'"),
        ("my_robots:Half", "lacks observe, move_to, release, position"),
    ):
        with pytest.raises(ValueError, match=message):
            lab.load_robot(name)

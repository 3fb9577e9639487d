"""A run stops with a reason, and says that a knot is tied only where it is seen."""

from io import BytesIO

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Channel
from mcap.stream_reader import StreamReader

from knotflow.apps import lab
from knotflow.execution import TrueState, Twin, TwinConfig
from knotflow.execution.robot import RobotWrapper
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


def last_said(path):
    """The last text of a log, in its message's bytes."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        *_, (_, _, message) = make_reader(file).iter_messages(topics=["/topology"])
    return message.data


def test_a_fault_of_the_driver_ends_the_run_and_opens_the_fingers(start, twin, tmp_path):
    robot = Faulty(twin.robot())
    done = start(robot)
    assert not done.tied and "failed at grasp: RuntimeError('motor 3 is off')" in done.reason
    assert robot.released
    assert done.reason.encode() in last_said(tmp_path / "run.mcap")


def test_a_fault_is_told_with_fingers_that_stay_closed(start, twin):
    robot, opened = Faulty(twin.robot()), []

    def release(self):
        if opened:
            raise RuntimeError("not homed")
        opened.append(True)

    robot.__class__ = type("Jammed", (Faulty,), {"release": release})
    reason = start(robot).reason
    assert "motor 3 is off" in reason and "may still be closed: the robot failed at" in reason


@pytest.mark.parametrize("fails", ["move_to", "position", "expect"])
def test_every_fault_but_a_late_image_ends_the_run_with_open_fingers(start, twin, fails):
    robot = Faulty(twin.robot())

    def fail(*_):
        raise TimeoutError("no answer")

    wrong = {fails: property(fail) if fails == "position" else fail, "grasp": lambda self: None}
    robot.__class__ = type("Late", (Faulty,), wrong)
    done = start(robot)
    assert not done.tied and f"failed at {fails}: TimeoutError('no answer')" in done.reason
    assert robot.released


def test_a_person_who_is_gone_says_no(monkeypatch, capsys):
    def gone(prompt):
        raise EOFError

    monkeypatch.setattr("builtins.input", gone)
    assert not lab.ask(yes=False)("the gripper moves")
    assert lab.ask(yes=True)("the gripper moves")
    assert capsys.readouterr().out.count("the gripper moves") == 2


def test_two_runs_have_two_logs(tmp_path, monkeypatch):
    monkeypatch.setattr(lab.time, "strftime", lambda form: "now")
    names = []
    for _ in range(3):
        names.append(lab.log_path(tmp_path, "overhand"))
        names[-1].touch()
    assert [one.name for one in names] == [
        "overhand-now.mcap",
        "overhand-now-2.mcap",
        "overhand-now-3.mcap",
    ]


def test_what_happened_outlives_the_process(tmp_path, twin):
    log = RunLog(tmp_path / "run.mcap", {})
    log.say("grasp")
    kept = (tmp_path / "run.mcap").read_bytes()
    log.__exit__()
    assert (tmp_path / "run.mcap").read_bytes().startswith(kept)
    records, told = StreamReader(BytesIO(kept)).records, []
    with pytest.raises(EndOfFile):
        told.extend(one.topic for one in records if isinstance(one, Channel))
    assert "/topology" in told


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
    (tmp_path / "my_robots.py").write_text(
        "from tests_lab_arm import Arm\nclass Half: grasp = 1\n"
        "def absent(): raise RuntimeError('off')\n"
        "def late():\n    import tests_lab_late\n    return tests_lab_late.Arm()\n"
        "class Method(Arm):\n    def position(self): return 0, 0, 0\n"
    )
    (tmp_path / "tests_lab_arm.py").write_text(
        "class Arm:\n    position = 0\n    observe = move_to = grasp = release = print\n"
    )
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests_lab_late.py").write_text(
        "from tests_lab_arm import Arm as Other\nclass Arm(Other):\n"
        "    @property\n    def position(self): raise RuntimeError('not yet')\n"
    )
    (tmp_path / "broken.py").write_text("raise RuntimeError('no driver')\n")
    assert type(lab.load_robot("my_robots:Arm")).__name__ == "Arm"
    assert type(lab.load_robot("my_robots:late")).__name__ == "Arm"
    for name, message in (
        ("my_robots", "write twin, or a driver as my_lab.robots:Arm"),
        ("my_robots:Leg", "has no attribute 'Leg'"),
        ("no_such_lab:Arm", "No module named 'no_such_lab'"),
        ("broken:Arm", "broken:Arm: RuntimeError: no driver"),
        ("my_robots:absent", "my_robots:absent: RuntimeError: off"),
        ("my_robots:Half", "lacks observe, move_to, release, position"),
        ("my_robots:Method", "position is a method; make it a property"),
    ):
        with pytest.raises(ValueError, match=message):
            lab.load_robot(name)


@pytest.mark.parametrize("position", ["0 0 0.3", ((0, 0, 0.3), np.eye(3)), object()])
def test_a_position_that_is_no_numbers_is_the_robots_fault(twin, tmp_path, position):
    class Odd(RobotWrapper):
        @property
        def position(self):
            return position

    with (
        RunLog(tmp_path / "run.mcap", {}) as log,
        pytest.raises(lab.LabError, match="the robot failed at position"),
    ):
        lab.LoggedRobot(Odd(twin.robot()), log).position  # noqa: B018


def test_what_a_camera_gives_is_an_image(twin, tmp_path):
    class Pair(RobotWrapper):
        def observe(self):
            return np.zeros((4, 4, 3), np.uint8), np.ones((4, 4))

    with RunLog(tmp_path / "run.mcap", {}) as log, pytest.raises(lab.LabError, match="got tuple"):
        lab.LoggedRobot(Pair(twin.robot()), log).observe()

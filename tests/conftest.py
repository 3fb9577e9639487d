"""What tests of several rooms share."""

import gc
import os
import platform
import shutil
import sys
from collections import Counter
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    Rollouts,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    control_points,
    resample,
    spline_path,
    straight,
)
from knotflow.topology import Arrange, TopologicalState
from knotflow.topology.draw import draw


def why_not_headless():
    """What is missing for a Rerun viewer without a screen; "" when nothing is."""
    if find_spec("rerun") is None:
        return "rerun-sdk is not installed"
    if platform.system() != "Linux":
        return ""  # macOS and Windows bring Metal and DirectX
    drivers = [Path(root, "vulkan/icd.d") for root in ("/usr/share", "/etc", "/usr/local/share")]
    if not find_library("vulkan") or not any(list(place.glob("*.json")) for place in drivers):
        return "no Vulkan driver (Debian: apt-get install mesa-vulkan-drivers libvulkan1)"
    return ""


@pytest.fixture
def headless():
    """Skips where no viewer can run without a screen."""
    if problem := why_not_headless():
        pytest.skip(problem)


def pytest_configure():
    """With KNOTFLOW_REQUIRE_BROWSER=1, fail at once where tests would be skipped for want of a
    browser or of a renderer."""
    if os.environ.get("KNOTFLOW_REQUIRE_BROWSER") != "1" or "PYTEST_XDIST_WORKER" in os.environ:
        return
    missing = [] if shutil.which("chromium") else ["chromium"]
    missing += [name for name in ("playwright", "viser") if find_spec(name) is None]
    if problem := why_not_headless():
        missing.append(f"a viewer without a screen ({problem})")
    if missing:
        raise pytest.UsageError(f"KNOTFLOW_REQUIRE_BROWSER: missing {', '.join(missing)}")


def pytest_collection():
    gc.disable()


def pytest_collection_finish():
    """What was imported stays, so the garbage collector need not look at it again and again."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items):
    """Files of slow tests first, so that the last ones spread evenly over the workers."""
    tests = Counter(item.path for item in items)
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path] / tests[item.path])


@pytest.fixture(scope="session")
def simulator():
    """The default simulator; building it is slower than using it."""
    return RopeSimulator(SimulationConfig(threads=2))


@pytest.fixture(scope="session", autouse=True)
def no_worker_outlives_the_tests():
    """loky's idle workers live on for minutes, and the interpreter may wait for them at its end."""
    yield
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def interrupted_training(monkeypatch):
    """A context manager in which trainings are interrupted after so many rounds, once the driver
    has had its time to save them."""
    from knotflow.training.trainer import Trainer

    @contextmanager
    def interrupted(rounds):
        whole = Trainer.__iter__

        def some(self):
            yield from islice(whole(self), rounds)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt), monkeypatch.context() as patch:
            patch.setattr(Trainer, "__iter__", some)
            yield

    return interrupted


@pytest.fixture
def two_threads():
    """PyTorch on two threads, so that it is seen who computes on one and puts the two back."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def command(monkeypatch, capfd):
    """`python -m knotflow` with arguments, in this process, which has its imports behind it."""
    from hydra.core.singleton import Singleton

    from knotflow.__main__ import main
    from knotflow.experiments.config import register

    def run(*arguments, results):
        register()
        hydra = Singleton.get_state()
        capfd.readouterr()
        code, why = 0, ""
        try:
            asked = [*map(str, arguments), f"results_dir={results}"]
            monkeypatch.setattr(sys, "argv", ["knotflow", *asked])
            main()
        except SystemExit as end:
            code, why = (end.code, "") if isinstance(end.code, int) else (1, str(end.code))
        finally:
            Singleton.set_state(hydra)
        out, err = capfd.readouterr()
        return CompletedProcess(arguments, code, out, err + why)

    return run


@pytest.fixture
def make_rollout():
    """A recorded rollout by its number: a rope whose middle is dragged along a spline."""
    return dragged_rope


def dragged_rope(number, frames=26, vertices=41, **changes):
    """Rollout `number`: every number of it differs from that of any other."""
    from knotflow.recording import RecordedRollout

    rng = np.random.default_rng(number)
    along = np.linspace(0.0, 1.0, vertices)
    rest = np.stack([along - 0.5, 0.1 * np.sin(6 * along + number), np.full(vertices, 0.008)], 1)
    grasp = rng.uniform(0.1, 0.9)
    first = np.array([np.interp(grasp, along, rest[:, axis]) for axis in range(3)])
    middle = rng.uniform([-0.2, -0.2, 0.1], [0.2, 0.2, 0.3])
    end = np.array([*rng.uniform(-0.4, 0.4, 2), 0.008])
    controls = np.stack([first, middle, end])
    gripper = spline_path(controls, np.linspace(0.0, 1.0, frames))
    near = np.exp(-(((along - grasp) / 0.15) ** 2))
    points = rest + near[None, :, None] * (gripper - first)[:, None, :]
    points += rng.normal(size=points.shape) * 1e-6  # a simulator's last bits are never alike
    rollout = RecordedRollout(
        times=0.25 + np.linspace(0.0, 2.5, frames),
        points=points,
        gripper=gripper,
        control_points=controls,
        spline=np.array([grasp, *middle, *end[:2]]),
        action="C(0,1,1)",
        start_state="[(2,1,+1)]",
        goal_state="[(1,3,+1),(4,2,+1)]",
        end_state="[(1,3,+1),(4,2,+1)]" if number % 2 else "",
        outcome="success" if number % 2 else "failure",
        signature="0123abcd",
        source="scripted",
        number=number,
        extra={"demonstration": str(number)},
    )
    return replace(rollout, **changes)


# Fine links, so that every drawing of a state reads back as it.
CONFIG = SimulationConfig(rope=RopeConfig(links=120, radius=0.004))
PATH = "R1(0,1,1) C(0,1,1) C(2,0,1)"


@cache
def shape(state):
    """A rope (V, 3) at rest in a state."""
    if state.num_crossings == 0:
        return straight(CONFIG.rope)
    points = resample(draw(state, gap=2 * CONFIG.rope.radius), CONFIG.rope)
    points[:, 2] += CONFIG.rope.radius
    assert TopologicalState.from_curve(points) == state
    return points


def long_headed(state, share):
    """As `shape`, with so much of the rope's length added before the head."""
    points = shape(state)
    outward = points[0] - points[1]
    begin = points[0] + share * outward * CONFIG.rope.links
    longer = resample(np.concatenate([[begin], points]), CONFIG.rope)
    assert TopologicalState.from_curve(longer) == state
    return longer


RELEASE = 1.8
"""Seconds from grasp to release in the obedient world."""


class World:
    """Sampler and simulator in one: a spline succeeds with a given chance, else nothing moves."""

    config = CONFIG

    def __init__(self, chance=1.0, diverges=False):
        self.chance, self.diverges = chance, diverges
        self.ends = {}
        self.batches = []
        self.requests = []

    def sample(self, points, action, count, rng):
        return self._splines(points, action, count, rng)

    def arrange(self, points, action, count, rng):
        return self._splines(points, Arrange(action), count, rng)

    def _splines(self, points, action, count, rng):
        state = TopologicalState.from_curve(points)
        self.requests.append((str(state), str(action), count))
        splines = rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))
        for spline in splines:
            succeeds = rng.random() < self.chance
            end = shape(state.apply(action)) if succeeds else points
            self.ends[spline.tobytes()] = end
        return splines

    def execute(self, points, splines):
        self.batches.append(len(points))
        times = np.linspace(0.0, 2.5, 26)
        done = np.minimum(times / RELEASE, 1.0)
        ends = np.stack(
            [
                self.ends.get(spline.tobytes(), start)  # a guess moves nothing
                for start, spline in zip(points, splines, strict=True)
            ]
        )
        share = done[:, None, None]
        moved = points[:, None] + share * (ends - points)[:, None]
        controls = control_points(points, splines, self.config.rope.radius)
        ease = done**2 * (3 - 2 * done)
        return Rollouts(
            times=times,
            trajectory=moved.astype(np.float32),
            gripper=spline_path(controls, ease).astype(np.float32),
            frames=np.full(len(points), len(times)),
            release_times=np.full(len(points), RELEASE),
            end_points=ends,
            diverged=np.full(len(points), self.diverges),
        )


@pytest.fixture
def world():
    return World


@pytest.fixture
def shape_of():
    return shape


@pytest.fixture
def long_headed_shape_of():
    return long_headed


@pytest.fixture(scope="session")
def path_goal():
    from knotflow.planning import parse_goal

    return parse_goal(PATH)


@pytest.fixture(scope="session")
def plan(path_goal):
    """An overhand in three steps."""
    from knotflow.planning import PlannerConfig, plan_knot

    world = World(chance=0.5)
    config = PlannerConfig(batch=4)
    points = straight(CONFIG.rope)
    return plan_knot(points, path_goal, world, world, np.random.default_rng(0), config)

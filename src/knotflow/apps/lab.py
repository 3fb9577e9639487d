"""A knot tied by a robot: look, plan the next action, ask, act, and look again."""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from inspect import getattr_static, isroutine
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from knotflow.execution import (
    Execution,
    ExecutionConfig,
    ImageStateEstimator,
    Robot,
    Twin,
    TwinConfig,
    encode_jpeg,
    execute,
)
from knotflow.execution.closed_loop import Allow, Confirm, Replan
from knotflow.execution.robot import Observation, RobotError, RobotWrapper
from knotflow.execution.step_executor import StepExecutor
from knotflow.perception import Camera, RgbdImage
from knotflow.planning import Goal, KnotPlan, PlanStep, parse_goal
from knotflow.recording import RunLog
from knotflow.simulation import RopeConfig, random_curve
from knotflow.topology import TopologicalState
from knotflow.topology.action_text import describe

Given = TypeVar("Given")


class LabError(Exception):
    """A robot that cannot be used, or that failed."""


def load_robot(name: str) -> Robot:
    """The robot of a text such as my_lab.robots:Arm, called without arguments.

    Raises:
        ValueError: there is no such module or attribute, it fails, or lacks a method of `Robot`.
    """
    module, colon, attribute = name.partition(":")
    if not (module and colon and attribute):
        raise ValueError(f"--robot {name}: write twin, or a driver as my_lab.robots:Arm")
    sys.path.insert(0, "")  # as `python -m` does
    try:
        factory = getattr(import_module(module), attribute)
        robot: Robot = factory()
    except Exception as error:  # whatever its libraries raise
        raise ValueError(f"--robot {name}: {type(error).__name__}: {error}") from error
    finally:
        sys.path.remove("")
    methods = ("observe", "move_to", "grasp", "release", "position")
    if missing := [one for one in methods if not _has(robot, one)]:
        raise ValueError(
            f"--robot {name} lacks {', '.join(missing)}; a robot has {', '.join(methods)}, see "
            "knotflow.execution.Robot"
        )
    if isroutine(getattr_static(robot, "position", None)):
        raise ValueError(f"--robot {name}: position is a method; make it a property (@property)")
    return robot


def _has(robot: object, name: str) -> bool:
    """Whether it has an attribute, without asking a property."""
    return getattr_static(robot, name, None) is not None or hasattr(robot, name)


def make_twin(rope: RopeConfig, camera: Camera, level: int, seed: int) -> Robot:
    """A simulated robot above a random rope, see `execution.Twin`."""
    rng = np.random.default_rng(seed)
    return Twin(random_curve(rope, rng), TwinConfig(level=level, rope=rope), rng, camera).robot()


class LoggedRobot(RobotWrapper):
    """A robot whose images and motions are logged, and whose faults are `LabError`s."""

    def __init__(self, robot: Robot, log: RunLog) -> None:
        super().__init__(robot)
        self._log = log

    def observe(self) -> RgbdImage:
        image = self._try(super().observe, late=TimeoutError)
        if not isinstance(image, RgbdImage):
            kind = type(image).__name__
            raise LabError(f"the robot's observe() gives knotflow.perception.RgbdImage, got {kind}")
        self._log.image(encode_jpeg(image))
        return image

    def move_to(self, position: NDArray, seconds: float) -> None:
        self._try(super().move_to, position, seconds)
        self._log.gripper(position)

    def grasp(self) -> None:
        self._try(super().grasp)
        self._log.say("grasp")

    def release(self) -> None:
        self._try(super().release)
        self._log.say("release")

    @property
    def position(self) -> NDArray:
        def position() -> NDArray:
            return np.asarray(self.robot.position, np.float64)

        return self._try(position)

    def expect(self, positions: NDArray, seconds: float, strand: float | None = None) -> bool:
        return self._try(super().expect, positions, seconds, strand)

    def open_to(self, opening: float) -> None:
        self._try(super().open_to, opening)

    def _try(
        self,
        command: Callable[..., Given],
        *arguments: object,
        late: type[Exception] | tuple[()] = (),
    ) -> Given:
        """What a command gives; an error `late` passes."""
        try:
            return command(*arguments)
        except late:
            raise
        except Exception as error:
            self._log.say(f"failed: {error!r}")
            raise LabError(f"the robot failed at {command.__name__}: {error!r}") from error


@dataclass(frozen=True)
class Tied:
    """How a run ended."""

    tied: bool
    reason: str
    execution: Execution | None = None


def tie(
    knot: str, robot: Robot, camera: Camera, rope: RopeConfig, replan: Replan, confirm: Confirm,
    log: RunLog, config: ExecutionConfig | None = None, allow: Allow | None = None,
) -> Tied:  # fmt: skip
    """Tie a knot into the rope that the camera, at its nominal pose, sees.

    `replan` plans for a rope (V, 3), metres. Every step is shown to `confirm` before it is
    executed; `allow` is asked before the gripper first moves, and before an end is pulled. A robot
    that fails ends the run, and its fingers are opened.

    Raises:
        ValueError: see `parse_goal`.
    """
    goal, config = parse_goal(knot), config or ExecutionConfig()
    logged = LoggedRobot(robot, log)
    estimator = ImageStateEstimator(camera, rope)
    x, y, z = (1e3 * np.array(config.park_position)).round().astype(int)
    if allow is not None and not allow(
        f"before every image the gripper moves to [{x}, {y}, {z}] mm, and if the image is in doubt "
        f"to [{x}, {-y}, {z}] mm"
    ):
        done = Tied(False, "the gripper was not allowed to move out of the way")
        log.say(done.reason)
        return done
    try:
        logged.release()
        seen = StepExecutor(logged, config).observe(estimator, 0)
        if seen.points is None:
            done = Tied(False, f"the rope is not seen: {'; '.join(seen.all_ambiguities)}")
        else:
            log.rope(seen.points)
            execution = execute(
                _begin(goal, seen, rope), logged, config, estimator=estimator, replan=replan,
                confirm=confirm, allow=allow,
            )  # fmt: skip
            done = Tied(bool(execution.tied), execution.reason, execution)
    except (LabError, RobotError) as error:
        done = Tied(False, "; ".join([str(error), *getattr(error, "__notes__", ())]))
    finally:
        with suppress(LabError):
            logged.release()
    last = done.execution and done.execution.observation
    if last is not None and last.points is not None:
        log.rope(last.points)
    log.say(done.reason)
    return done


def _begin(goal: Goal, seen: Observation, rope: RopeConfig) -> KnotPlan:
    """A plan of no steps, from which everything has to be planned."""
    assert seen.points is not None
    return KnotPlan(
        goal=goal.name,
        goal_states=tuple(goal.states),
        solved=False,
        reason="nothing is planned yet",
        start=seen.points,
        start_state=seen.state or TopologicalState.trivial(),
        steps=(),
        tried=(),
        branches=0,
        kept=0,
        seconds=0.0,
        radius=rope.radius,
    )


def ask(yes: bool) -> Allow:
    """Says what is to be done, and asks on the terminal unless everything is allowed."""

    def allow(motion: str) -> bool:
        print(motion)
        try:
            return yes or input("go on? [y/N] ").strip().lower() in ("y", "yes")
        except EOFError:
            return False

    return allow


def show(allow: Allow) -> Confirm:
    """Says what each step is, and asks `allow`."""

    def confirm(step: PlanStep, plan: KnotPlan) -> bool:
        grasp, middle, end = (1e3 * plan.controls[0]).round().astype(int).tolist()
        told = (
            f"{len(plan.steps)} actions to {plan.goal}; the next is\n"
            f"  {describe(step.action, step.start_state)}\n"
            f"grasp    {grasp} mm\nthrough  {middle} mm\nrelease  {end} mm"
        )
        if plan.worlds:
            told += f"\nsuccess  in {plan.survived[0]} of {plan.worlds} worlds"
        if not plan.solved:
            told += f"\nno whole plan was found: {plan.reason}"
        return allow(told)

    return confirm


def log_path(folder: Path, knot: str) -> Path:
    """A name that is not taken yet."""
    name = f"{knot.split(maxsplit=1)[0]}-{time.strftime('%Y%m%d-%H%M%S')}"
    numbered = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
    return next(path for one in numbered if not (path := folder / f"{one}.mcap").exists())

"""One step of a plan executed by a robot, in open loop or corrected while it moves (Sec. VI).

In closed loop the gripper grasps the rope where it lies, and every 0.1 s a controller chooses the
next move from the rope's state, so that it follows the rope of the plan.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.motions import STEP
from knotflow.execution.robot import (
    CameraTimer,
    Observation,
    Robot,
    RobotError,
    RopeSource,
    StateEstimator,
)
from knotflow.planning import GripperConfig, KnotPlan, PlanStep
from knotflow.planning.waypoints import trace_waypoints
from knotflow.simulation import grasped_link
from knotflow.topology import TopologicalState, project

MAX_CORRECTION = 0.03
"""Largest error of the robot along each axis that is made up for, metres."""
MOST_LOWERED = 0.002
"""By which a gripper that is too high is sent lower, metres, at most to half its height: fingers on
the table cannot go on."""
MOST_ASTRAY, MOST_TICKS_ASTRAY = 0.1, 10
"""A robot that is farther from where it was sent, metres, after so many moves does not follow."""
CROSSING_WIDTH = 0.08  # share of the rope around each crossing within which vertices matter most
CROSSING_WEIGHT = 4.0  # how much more a vertex at a crossing matters than one far from it
MAX_OBSERVATIONS = 2  # of an ambiguous rope before it is pulled
PULL_DISTANCE = 0.04  # metres
FARTHEST = 10.0  # metres from the origin, that a gripper may be


class Controller(Protocol):
    """Chooses the gripper's moves while it drags the rope."""

    def begin(self, reference: NDArray, path: NDArray, weights: NDArray, grasped: int) -> None:
        """Take up a spline: the desired rope (T + 1, V, 3), the planned path (T + 1, 3), the
        vertices' weights (V,) and the index of the held link."""

    def act(self, points: NDArray, velocities: NDArray, gripper: NDArray) -> NDArray:
        """The gripper's position (3,) a tick from now, from the rope's state (V, 3)."""


@dataclass
class ExecutionConfig:
    """How a plan is executed."""

    gripper: GripperConfig = field(default_factory=GripperConfig)
    """Heights and speeds between splines."""
    slip: float = 0.03
    """Distance from the gripper at which the held link counts as lost, metres."""
    lag: float = 0.05
    """Seconds by which the held link may trail a moving gripper in addition."""
    attempts: int = 3
    """Grasps of a step, in closed loop, while it misses or slips."""
    park_position: tuple[float, float, float] = (0.0, 0.45, 0.3)
    """Where the gripper waits while the rope is observed, metres; the next time opposite."""
    max_pulls: int = 2
    """Pulls at an ambiguous rope's ends, in turn, with replanning."""
    image_timeout: float = 3.0
    """Seconds that a new image is waited for."""
    max_unsolved: int = 3
    """Unsolved plans in a row, with replanning."""
    max_actions: int = 20
    """Actions before giving up, with replanning."""


class Move(NamedTuple):
    """One move of the robot; see `Execution` for units."""

    gripper: NDArray[np.float64]
    closed: bool
    step: int
    reference: NDArray[np.float64] | None
    points: NDArray[np.float64] | None


@dataclass(frozen=True)
class TickTiming:
    """What a move that the controller chose took, seconds."""

    image: float
    track: float
    control: float


@dataclass(frozen=True)
class StepOutcome:
    """Outcome of one executed step."""

    step: PlanStep  # as it was planned
    observed_state: TopologicalState | None  # after it; None: not observed, or cannot be read
    held: bool  # whether the rope was held until its release, as far as it was tracked
    tracked: bool  # whether the track was not lost


@dataclass(eq=False)
class StepExecutor:
    """Executes steps of a plan and records every move."""

    robot: Robot
    config: ExecutionConfig
    source: RopeSource | None = None
    controller: Controller | None = None
    corrects: bool = False  # whether the robot's own error is compensated
    points: NDArray | None = None  # (V, 3) the rope as last seen
    previous_points: NDArray | None = None  # (V, 3) the rope as seen a move earlier
    closed: bool = False
    commanded: NDArray = field(default_factory=lambda: np.zeros(3))  # where it was last sent
    error: NDArray = field(default_factory=lambda: np.zeros(3))  # of the robot's position, metres
    moves: list[Move] = field(default_factory=list)
    ticks: list[TickTiming] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._camera = CameraTimer(self.robot)
        self._expected = 0  # moves that the robot makes as one motion
        self._astray = 0  # moves in a row after which the robot was far off
        self._unmeasured = 0  # moves since its position was last asked for

    def execute(self, step: PlanStep, plan: KnotPlan, number: int) -> StepOutcome:
        """Grasp, drag, let go and rise."""
        self._track()
        rope = step.start if self.points is None else self.points
        link = int(grasped_link(step.spline, len(rope) - 1))
        path = path_from_grasp(step, (rope[link] + rope[link + 1]) / 2)
        shapes = np.stack([step.start, step.end])
        gripper = self.config.gripper.clear_of(shapes, plan.radius)
        waypoints = trace_waypoints(
            [replace(step, gripper=path)], shapes, plan.radius, 1 / STEP, gripper
        )
        drag = np.flatnonzero([phase == "drag" for phase in waypoints.phases])
        before, after = waypoints.positions[: drag[0]], waypoints.positions[drag[-1] + 1 :]
        x, y, _ = rope[link + 1] - rope[link]
        strand, closing = float(np.arctan2(y, x)), waypoints.phases.index("close")
        self._camera.open_to(float(waypoints.openings[0]))
        self._travel(before[0], number, strand)
        self._follow(before[:closing], number, strand)
        self._grasp()
        self._follow(before[closing:], number, strand, track=True)
        planned = np.concatenate([before[-1:], waypoints.positions[drag]])
        held = self._drag(step, planned, number)
        self._camera.open_to(float(waypoints.openings[-1]))
        self._release()
        positions = after + self.commanded - planned[-1]
        positions[:, 2] = np.maximum(positions[:, 2], planned[-1, 2])
        opening = waypoints.phases.count("open")
        self._follow(positions[:opening], number, track=True)
        self._follow(positions[opening:], number)
        return StepOutcome(step, None, held, self.source is None or not self.source.lost)

    def observe(
        self, estimator: StateEstimator, number: int, likely: Sequence[NDArray] = ()
    ) -> Observation:
        """Go out of the way and observe, and again from the other side if it is ambiguous."""
        timeout = self.config.image_timeout
        observation = Observation(None, None, (f"no new image came for {timeout:g} s",))
        for turn in range(MAX_OBSERVATIONS):
            position = np.array(self.config.park_position) * [1, (-1) ** turn, 1]
            self._travel(position, number)
            self._move(position, number)
            waited, asked = 0.0, time.monotonic()
            while (found := estimator.estimate(self.robot, likely)) is None and waited < timeout:
                waited += max(STEP, time.monotonic() - asked)  # a driver may have waited, too
                self._move(position, number)
                asked = time.monotonic()
            observation = found or observation
            if found is None or not found.ambiguities:
                break
        self.previous_points = self.points = observation.points
        return observation

    def pull(self, number: int, radius: float, ends: Sequence[int] = (), turn: int = 0) -> None:
        """Pull an end of a rope, of that radius in metres, along itself, which undoes no crossing.

        `ends` (0: head, -1: tail) take turns; by default both, the outer one first.
        """
        assert self.points is not None
        gripper, points = self.config.gripper.clear_of(self.points, radius), self.points
        from_middle = np.linalg.norm((points - points.mean(axis=0))[:, :2], axis=1)
        ends = ends or ((0, -1) if from_middle[0] >= from_middle[-1] else (-1, 0))
        if ends[turn % len(ends)] == -1:
            points = points[::-1]
        outward = (points[0] - points[4]) * [1.0, 1.0, 0.0]
        begin = (points[0] + points[1]) / 2
        begin[2] = max(begin[2], gripper.lowest)
        step = PULL_DISTANCE / max(float(np.linalg.norm(outward)), 1e-9)
        end = begin + step * outward
        above, raised = np.array([begin, end])
        above[2], raised[2] = gripper.approach_height, gripper.retreat_height
        speed, strand = gripper.vertical_speed, float(np.arctan2(outward[1], outward[0]))
        self._travel(above, number, strand)
        self._line(above, begin, speed, number, strand)
        self._grasp()
        closing = np.tile(begin, (round(gripper.close_time / STEP), 1))
        self._follow(closing, number, strand, track=True)
        self._line(begin, end, speed, number, track=True)
        self._release()
        self._line(end, raised, speed, number, track=True)

    def _grasp(self) -> None:
        self.robot.grasp()
        self.closed = True

    def _release(self) -> None:
        self.robot.release()
        self.closed = False

    def _travel(self, position: NDArray, number: int, strand: float | None = None) -> None:
        speed = self.config.gripper.travel_speed
        self._line(self._position(), position, speed, number, strand)

    def _line(
        self, begin: NDArray, end: NDArray, speed: float, number: int,
        strand: float | None = None, track: bool = False,
    ) -> None:  # fmt: skip
        """Move on a line from rest to rest."""
        # The smooth step 3u^2 - 2u^3 is at most 1.5 times as fast as its mean.
        count = int(np.ceil(1.5 * float(np.linalg.norm(end - begin)) / speed / STEP))
        u = np.arange(1, count + 1)[:, None] / max(count, 1)
        positions = begin + u * u * (3.0 - 2.0 * u) * (end - begin)
        self._follow(positions, number, strand, track)

    def _follow(
        self, positions: NDArray, number: int, strand: float | None = None, track: bool = False
    ) -> None:
        """Move to positions (N, 3), across a strand of that direction if given."""
        self._expect(positions, strand)
        for position in positions:
            self._move(position, number, track=track)

    def _expect(self, positions: NDArray, strand: float | None = None) -> None:
        """Announce moves that nothing seen on the way will change."""
        if self.source is None and len(positions):
            announced = self._camera.expect(self._corrected(positions), STEP, strand)
            self._expected = len(positions) if announced else 0

    def _drag(self, step: PlanStep, path: NDArray, number: int) -> bool:
        """Whether the rope was held along path (T + 1, 3), or as the controller corrected it."""
        reference = interpolate_rope(step, np.linspace(0.0, step.release_time, len(path)))
        self._expect(path[1:])
        at_grasp = self._link_distances()
        link = int(at_grasp.argmin())
        if self.controller is not None:
            self.controller.begin(reference, path, self._weights(step), link)
        for position, rope in zip(path[1:], reference[1:], strict=True):
            before, began = self.commanded, time.perf_counter()
            if self.controller is not None:
                assert self.points is not None and self.previous_points is not None
                velocities = (self.points - self.previous_points) / STEP
                position = self.controller.act(self.points, velocities, self.robot.position)
            control = time.perf_counter() - began
            image, track = self._move(position, number, rope, track=True)
            if self.controller is not None:
                self.ticks.append(TickTiming(image, track, control))
            trailing = self.config.lag * float(np.linalg.norm(position - before)) / STEP
            allowed = at_grasp[link] + self.config.slip + trailing
            if self.source is not None and self._link_distances()[link] > allowed:
                return False
        if not self.corrects and not self._expected:
            off = self._position() - self.commanded
            if np.linalg.norm(off) > MOST_ASTRAY:
                raise self._astray_error(off)
        return True

    def _link_distances(self) -> NDArray[np.float64]:
        """(V - 1,) of the links' centres from the gripper, metres; 0 where no rope is seen."""
        if self.points is None:
            return np.zeros(1)
        centres = (self.points[1:] + self.points[:-1]) / 2
        return np.linalg.norm(centres - self.robot.position, axis=1)

    def _weights(self, step: PlanStep) -> NDArray[np.float64]:
        """(V,) of the vertices: most at the crossings of the step's end."""
        along = np.linspace(0.0, 1.0, len(step.end))
        weights = np.ones(len(along))
        for fraction in project(step.end).fractions:
            near = np.exp(-0.5 * ((along - fraction) / CROSSING_WIDTH) ** 2)
            weights = np.maximum(weights, 1 + (CROSSING_WEIGHT - 1) * near)
        return weights / weights.mean()

    def _move(
        self, position: NDArray, number: int, reference: NDArray | None = None, track: bool = False
    ) -> tuple[float, float]:
        """Move for a tick; seconds that the image and the tracker took."""
        self.commanded = position
        self.robot.move_to(self._corrected(position), STEP)
        self._expected = max(self._expected - 1, 0)
        self._unmeasured += 1
        if self.corrects and not self._expected:
            off, moves = self._position() - position, self._unmeasured
            self._astray = self._astray + moves if np.linalg.norm(off) > MOST_ASTRAY else 0
            self._unmeasured = 0
            if self._astray >= MOST_TICKS_ASTRAY:
                raise self._astray_error(off, f", after {self._astray} moves")
            most = np.array([MAX_CORRECTION, MAX_CORRECTION, MOST_LOWERED])
            self.error = np.clip(self.error + off, -MAX_CORRECTION, most)
        took = self._track() if track else (0.0, 0.0)
        points = None if self.source is None else self.points
        self.moves.append(Move(position, self.closed, number, reference, points))
        return took

    def _astray_error(self, off: NDArray, when: str = "") -> RobotError:
        """For a gripper that is off (3,), metres, where it was sent."""
        return RobotError(
            f"the gripper is {np.linalg.norm(off):.2f} m from where it was sent{when}: "
            f"{(self.commanded + off).round(3).tolist()}, not {self.commanded.round(3).tolist()}"
        )

    def _corrected(self, positions: NDArray) -> NDArray[np.float64]:
        """Where to send the robot so that it arrives at positions (..., 3), metres."""
        sent = np.asarray(positions - self.error)
        sent[..., 2] = np.maximum(sent[..., 2], positions[..., 2] / 2)
        return sent

    def _position(self) -> NDArray[np.float64]:
        """Where the gripper is measured to be (3,), metres."""
        position = np.asarray(self.robot.position, np.float64)
        if position.shape != (3,):
            raise RobotError(f"the gripper's position is (3,), metres, got {position.shape}")
        if not np.isfinite(position).all():
            raise RobotError(f"the gripper is measured to be at {position.tolist()}")
        if (far := float(np.linalg.norm(position))) > FARTHEST:
            raise RobotError(
                f"the gripper is measured {far:.3g} m from the origin: positions are metres, "
                "in the frame of the table"
            )
        return position

    def _track(self) -> tuple[float, float]:
        """Track the rope; seconds that the image and the tracker took."""
        if self.source is None:
            return 0.0, 0.0
        began, image = time.perf_counter(), self._camera.seconds
        points = self.source.points(self._camera, self.closed)
        self.previous_points = points if self.points is None else self.points
        self.points = points
        image = self._camera.seconds - image
        return image, time.perf_counter() - began - image


def path_from_grasp(step: PlanStep, grasp: NDArray) -> NDArray[np.float64]:
    """The gripper's path (T, 3) of a step from another grasp (3,), metres.

    The offset fades until the release.
    """
    left = 1 - np.clip(step.times / step.release_time, 0.0, 1.0)
    return step.gripper + left[:, None] * (grasp - step.gripper[0])


def interpolate_rope(step: PlanStep, times: NDArray) -> NDArray[np.float64]:
    """The rope (N, V, 3) of a step at times (N,), seconds since the grasp."""
    at = np.interp(times, step.times, np.arange(len(step.times)))
    frame = np.minimum(at.astype(int), len(step.times) - 2)
    share = (at - frame)[:, None, None]
    return (1 - share) * step.trajectory[frame] + share * step.trajectory[frame + 1]

"""One step of a plan executed by a robot: as it was planned, or corrected while it moves (Sec. VI).

Open loop, the gripper goes where the plan says, whatever the rope does. In closed loop it grasps
the rope where it lies, and every tenth of a second a controller chooses the next move from the
rope's state, so that it follows the rope of the plan.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.control.motions import STEP
from knotflow.execution.control.observation import Observation, RopeSource, StateEstimator
from knotflow.execution.control.robot import CameraTimer, Robot
from knotflow.planning import GripperConfig, KnotPlan, PlanStep
from knotflow.planning.waypoints import trace_waypoints
from knotflow.simulation import grasped_link, spline_basis
from knotflow.topology import project

MAX_CORRECTION = 0.03
"""Largest error of the robot along each axis that is made up for, metres; more is a fault."""


class Controller(Protocol):
    """Chooses the gripper's moves while it drags the rope."""

    def begin(self, reference: NDArray, path: NDArray, weights: NDArray, grasped: int) -> None:
        """Take up a spline.

        Args:
            reference: (T + 1, V, 3) the rope that is wanted, at the grasp and after each move.
            path: (T + 1, 3) the gripper's planned path.
            weights: (V,) how much each vertex matters.
            grasped: index of the link that is held.
        """
        ...

    def act(self, points: NDArray, velocities: NDArray, gripper: NDArray) -> NDArray:
        """Where the gripper shall be (3,) a tick from now, from the rope (V, 3) and where it is."""
        ...


@dataclass
class ExecutionConfig:
    """How a plan is executed."""

    gripper: GripperConfig = field(default_factory=GripperConfig)
    """Heights and speeds between splines."""
    crossing_width: float = 0.08
    """Share of the rope around each crossing of a step's end within which vertices matter most."""
    crossing_weight: float = 4.0
    """How much more a vertex at a crossing matters than one far from it."""
    slip: float = 0.03
    """How far the held link may come away from the gripper before it counts as lost, metres,"""
    lag: float = 0.05
    """and by how much more where it trails a moving gripper, seconds: a simulated grip yields, so
    that its link is 0.04 s behind."""
    attempts: int = 3
    """How often a step is begun, in closed loop, whose grasp misses or slips."""
    park_position: tuple[float, float, float] = (0.0, 0.45, 0.3)
    """Where the gripper waits while the rope is observed, metres: out of the camera's way. For
    another observation it waits opposite."""
    max_observations: int = 2
    """How often the rope is observed while it is in doubt."""
    max_pulls: int = 2
    """How often a rope that stays in doubt is pulled at an end, where the plan continues from what
    is observed, and observed again; its ends take turns."""
    pull_distance: float = 0.04
    """How far, metres."""
    image_timeout: float = 3.0
    """How long a new image is waited for, seconds."""
    max_unsolved: int = 3
    """How many plans in a row may end before the goal, with replanning."""
    max_actions: int = 20
    """Give up after so many actions, with replanning."""


@dataclass(frozen=True, eq=False)
class Move:
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
class DragResult:
    """What became of a drag.

    Attributes:
        held: whether the rope was held until it was let go, as far as that was watched.
        tracked: whether it then was where it was tracked, as far as it was tracked.
    """

    held: bool
    tracked: bool


@dataclass(eq=False)
class StepExecutor:
    """Executes steps of a plan and notes down every move."""

    robot: Robot
    config: ExecutionConfig
    source: RopeSource | None = None
    controller: Controller | None = None
    corrects: bool = False
    """Whether the robot's own error is made up for."""
    points: NDArray | None = None
    """The rope as it was seen last."""
    previous_points: NDArray | None = None
    """The rope as it was seen a move earlier."""
    closed: bool = False
    commanded: NDArray = field(default_factory=lambda: np.zeros(3))
    """Where the gripper should have come last."""
    error: NDArray = field(default_factory=lambda: np.zeros(3))
    """How far off the robot is from where it is sent, metres."""
    moves: list[Move] = field(default_factory=list)
    ticks: list[TickTiming] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._camera = CameraTimer(self.robot)

    def execute(self, step: PlanStep, plan: KnotPlan, number: int) -> DragResult:
        """Grasp, drag, let go and rise; `number` is that of the step.

        The rope is tracked from the grasp until the fingers are open: else it lies still.
        """
        self._track()
        rope = step.start if self.points is None else self.points
        link = int(grasped_link(step.spline, len(rope) - 1))
        path = path_from_grasp(step, (rope[link] + rope[link + 1]) / 2, plan.move_time)
        waypoints = trace_waypoints(
            [(step.times, path, str(step.action))],
            np.stack([step.start, step.end]),
            plan.radius,
            plan.move_time,
            1 / STEP,
            self.config.gripper,
        )
        drag = np.flatnonzero([phase == "drag" for phase in waypoints.phases])
        before, after = waypoints.positions[: drag[0]], waypoints.positions[drag[-1] + 1 :]
        self._travel(before[0], number)
        for position, phase in zip(before, waypoints.phases, strict=False):
            if phase == "close" and not self.closed:
                self.robot.grasp()
                self.closed = True
            self._move(position, number, track=self.closed)
        planned = np.concatenate([before[-1:], waypoints.positions[drag]])
        held = self._drag(step, planned, number)
        self.robot.release()
        self.closed = False
        positions = after + self.commanded - planned[-1]
        positions[:, 2] = np.maximum(positions[:, 2], planned[-1, 2])
        for position, phase in zip(positions, waypoints.phases[drag[-1] + 1 :], strict=True):
            self._move(position, number, track=phase == "open")
        return DragResult(held, self.source is None or not self.source.lost)

    def observe(
        self, estimator: StateEstimator, number: int, likely: Sequence[NDArray] = ()
    ) -> Observation:
        """Go out of the way and observe, then from the other side if the rope is in doubt.

        Where that stays in doubt, the last observation says why. `likely` is for the estimator.
        """
        timeout = self.config.image_timeout
        observation = Observation.no_rope(f"no new image came for {timeout:g} s")
        for turn in range(self.config.max_observations):
            position = np.array(self.config.park_position) * [1, (-1) ** turn, 1]
            self._travel(position, number)
            self._move(position, number)
            waited = 0.0
            while (found := estimator.estimate(self.robot, likely)) is None and waited < timeout:
                waited += STEP
                self._move(position, number)
            observation = found or observation
            if found is None or not found.doubts:
                break
        self.previous_points = self.points = observation.points
        return observation

    def pull(self, number: int, ends: Sequence[int] = (), turn: int = 0) -> None:
        """Draw an end outward, so that what touches comes apart: of the given `ends`, 0 for the
        head and -1 for the tail, or else first of that which sticks out farther, they take turns.

        An end that leaves along itself undoes nothing that is tied. One that sticks out crosses
        nothing, and one that lies at a strand is then seen to cross it.
        """
        assert self.points is not None
        gripper, points = self.config.gripper, self.points
        from_middle = np.linalg.norm((points - points.mean(axis=0))[:, :2], axis=1)
        ends = ends or ((0, -1) if from_middle[0] >= from_middle[-1] else (-1, 0))
        if ends[turn % len(ends)] == -1:
            points = points[::-1]
        outward = (points[0] - points[4]) * [1.0, 1.0, 0.0]
        begin = (points[0] + points[1]) / 2
        step = self.config.pull_distance / max(float(np.linalg.norm(outward)), 1e-9)
        end = begin + step * outward
        above, raised = np.array([begin, end]) * [1, 1, 0] + [0, 0, gripper.approach_height]
        self._travel(above, number)
        for position in straight_moves(above, begin, gripper.vertical_speed):
            self._move(position, number)
        self.robot.grasp()
        self.closed = True
        closing = [begin] * round(gripper.close_time / STEP)
        for position in [*closing, *straight_moves(begin, end, gripper.vertical_speed)]:
            self._move(position, number, track=True)
        self.robot.release()
        self.closed = False
        for position in straight_moves(end, raised, gripper.vertical_speed):
            self._move(position, number, track=True)

    def _travel(self, position: NDArray, number: int) -> None:
        speed = self.config.gripper.travel_speed
        for one in straight_moves(self.robot.position, position, speed):
            self._move(one, number)

    def _drag(self, step: PlanStep, path: NDArray, number: int) -> bool:
        """Drag the rope along path (T + 1, 3) or as the controller says, unless it gets lost."""
        reference = interpolate_rope(step, STEP * np.arange(len(path)))
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
        return True

    def _link_distances(self) -> NDArray[np.float64]:
        """(V - 1,) of the links' centres from the gripper, metres; 0 where no rope is seen."""
        if self.points is None:
            return np.zeros(1)
        centres = (self.points[1:] + self.points[:-1]) / 2
        return np.linalg.norm(centres - self.robot.position, axis=1)

    def _weights(self, step: PlanStep) -> NDArray[np.float64]:
        """(V,) with the strands at the crossings of the step's end weighing most."""
        along = np.linspace(0.0, 1.0, len(step.end))
        weights = np.ones(len(along))
        for fraction in project(step.end).fractions:
            near = np.exp(-0.5 * ((along - fraction) / self.config.crossing_width) ** 2)
            weights = np.maximum(weights, 1 + (self.config.crossing_weight - 1) * near)
        return weights / weights.mean()

    def _move(
        self,
        position: NDArray,
        number: int,
        reference: NDArray | None = None,
        track: bool = False,
    ) -> tuple[float, float]:
        """Move for a tick, track the rope if it may move, and note it down.

        Returns:
            What the image and tracking the rope in it took, seconds.
        """
        self.commanded = position
        self.robot.move_to(position - self.error, STEP)
        if self.corrects:
            self.error = self.error + self.robot.position - position
            self.error = np.clip(self.error, -MAX_CORRECTION, MAX_CORRECTION)
        took = self._track() if track else (0.0, 0.0)
        points = None if self.source is None else self.points
        self.moves.append(Move(position, self.closed, number, reference, points))
        return took

    def _track(self) -> tuple[float, float]:
        """Track the rope; what the image and the rest took, seconds."""
        if self.source is None:
            return 0.0, 0.0
        began, image = time.perf_counter(), self._camera.seconds
        points = self.source.points(self._camera, self.closed)
        self.previous_points = points if self.points is None else self.points
        self.points = points
        image = self._camera.seconds - image
        return image, time.perf_counter() - began - image


def path_from_grasp(step: PlanStep, grasp: NDArray, move_time: float) -> NDArray[np.float64]:
    """The gripper's path (T, 3) of a step, begun at another place (3,), metres.

    What the beginning is off fades as the first control point's weight does.
    """
    share = np.clip(step.times / move_time, 0.0, 1.0)
    weight = spline_basis(share)[:, :1]
    return step.gripper + weight * (grasp - step.gripper[0])


def interpolate_rope(step: PlanStep, times: NDArray) -> NDArray[np.float64]:
    """The rope (N, V, 3) of a step at times (N,), seconds since the grasp."""
    at = np.interp(times, step.times, np.arange(len(step.times)))
    frame = np.minimum(at.astype(int), len(step.times) - 2)
    share = (at - frame)[:, None, None]
    return (1 - share) * step.trajectory[frame] + share * step.trajectory[frame + 1]


def straight_moves(begin: NDArray, end: NDArray, speed: float) -> NDArray[np.float64]:
    """Positions (N, 3), a tick apart, on a line from rest to rest; none if it is there."""
    # The smooth step 3u^2 - 2u^3 is at most 1.5 times as fast as its mean.
    count = int(np.ceil(1.5 * float(np.linalg.norm(end - begin)) / speed / STEP))
    u = np.arange(1, count + 1)[:, None] / max(count, 1)
    return begin + u**2 * (3.0 - 2.0 * u) * (end - begin)

"""A plan executed by a robot, open loop or replanned after each step, and evaluated (Sec. VI)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.dynamics import SHIPPED_DYNAMICS, ModelPrediction, MujocoDynamics
from knotflow.execution.motions import STEP
from knotflow.execution.robot import (
    ImageStateEstimator,
    Observation,
    Robot,
    RopeSource,
    StateEstimator,
    TrackedRope,
)
from knotflow.execution.step_executor import (
    PULL_DISTANCE,
    Controller,
    ExecutionConfig,
    StepExecutor,
    StepOutcome,
    TickTiming,
)
from knotflow.execution.twin import Twin
from knotflow.perception import Camera, StrandNetwork, Tracker
from knotflow.planning import Goal, KnotPlan, PlanStep, UnreachableGoalError
from knotflow.simulation import ShapeError, SimulationConfig, state_or_none
from knotflow.topology import DegenerateCurveError

Replan = Callable[[NDArray], KnotPlan]
"""Plans the rest of a knot from the rope (V, 3) as it lies."""
Confirm = Callable[[PlanStep, KnotPlan], bool]
"""Whether the next step of a plan may be executed."""
Allow = Callable[[str], bool]
"""Whether another motion, told in words, may be made."""


@dataclass(frozen=True, eq=False)
class Execution:
    """What was commanded and observed; a frame after each of the robot's N moves, metres."""

    times: NDArray[np.float64]  # (N,) seconds since the first move began
    gripper: NDArray[np.float64]  # (N, 3) commanded positions
    closed: NDArray[np.bool_]  # (N,) whether the fingers were commanded to be closed
    step: NDArray[np.int64]  # (N,) index of the action
    reference: NDArray[np.float64]  # (N, V, 3) the planned rope; NaN where the gripper drags none
    points: NDArray[np.float64]  # (N, V, 3) the tracked rope; NaN where it was not tracked
    ticks: tuple[TickTiming, ...]  # of each controlled move
    outcomes: tuple[StepOutcome, ...]  # of each step, in the order executed
    observation: Observation | None  # the last one of the rope
    tied: bool | None  # whether it shows a goal state unambiguously; None without an observation
    reason: str  # why the execution ended


def execute(
    plan: KnotPlan,
    robot: Robot,
    config: ExecutionConfig | None = None,
    source: RopeSource | None = None,
    controller: Controller | None = None,
    estimator: StateEstimator | None = None,
    replan: Replan | None = None,
    confirm: Confirm | None = None,
    allow: Allow | None = None,
) -> Execution:
    """Execute a plan on a robot.

    The `source` tracks the rope while it is dragged. A `controller` corrects the drag; without one,
    a spline begins at the tracked rope and is then followed open loop. The `estimator` reads the
    state at the end, and with `replan` after each action: the rest is then planned again, and the
    first step of the new plan, solved or not, executed if `confirm` allows it. Where the rope is in
    doubt, its ends are pulled if `allow` says so.

    Raises:
        ValueError: a controller without a source, `replan` without an estimator, or a plan without
            trajectories.
    """
    if controller is not None and source is None:
        raise ValueError("a controller needs a source that tracks the rope")
    if replan is not None and estimator is None:
        raise ValueError("replanning needs an estimator of the rope's state after each action")
    if any(len(step.trajectory) == 0 for step in plan.steps):
        raise ValueError("the plan was saved without trajectories, so there is nothing to follow")
    corrects = source is not None or replan is not None
    executor = StepExecutor(robot, config or ExecutionConfig(), source, controller, corrects)
    knot = _KnotExecution(executor, plan, estimator, confirm, allow)
    try:
        reason = knot.execute_steps() if replan is None else knot.execute_with_replanning(replan)
    except BaseException as error:
        try:
            robot.release()
        except Exception as failure:
            error.add_note(f"the fingers may still be closed: {failure}")
        raise
    robot.release()
    return knot.record(reason)


@dataclass(eq=False)
class _KnotExecution:
    """An execution under way."""

    executor: StepExecutor
    plan: KnotPlan
    estimator: StateEstimator | None
    confirm: Confirm | None = None
    allow: Allow | None = None
    outcomes: list[StepOutcome] = field(default_factory=list)
    observation: Observation | None = None

    def execute_steps(self) -> str:
        """Why the execution of all steps ended."""
        attempts = self.executor.config.attempts
        for number, step in enumerate(self.plan.steps):
            if not any(self._execute_step(step, self.plan) for _ in range(attempts)):
                reason = f"the rope was lost in all {attempts} attempts at step {number}"
                break
        else:
            whole = "" if self.plan.solved else " of a plan that does not tie the knot"
            reason = f"every step was executed{whole}"
        if self.estimator is None:
            return reason
        self._observe(self.plan.steps[-1].end if self.plan.steps else self.plan.start)
        return f"{reason}, and {self._observed()}"

    def execute_with_replanning(self, replan: Replan) -> str:
        """Plan, execute one step, observe, and so on; why it ended.

        Nothing is planned from an ambiguous rope, unless only an end is ambiguous: its shape is
        right within millimetres. A knot that depends on such an end is not reported.
        """
        config, lost, unsolved = self.executor.config, 0, 0
        observation = self._observe(self.plan.start, config.max_pulls)
        begins = self.plan.solved and observation.state == self.plan.start_state
        plan = self.plan if begins else None
        while observation.points is not None and not self._tied():
            done = len(self.outcomes)
            if self._in_doubt():
                return f"it cannot be planned after {done} actions: {self._observed()}"
            if lost == config.attempts:
                times = f"{lost} actions one after the other"
                return f"the rope was lost in {times}: {self._observed()}"
            if done == config.max_actions:
                return f"the knot is not tied after {done} actions: {self._observed()}"
            try:
                plan = plan or replan(observation.points)
            except (UnreachableGoalError, DegenerateCurveError, ShapeError) as error:
                return f"there is no plan after {done} actions: {error}"
            unsolved = 0 if plan.solved else unsolved + 1
            if unsolved > config.max_unsolved or (plan.solved and not plan.steps):
                return f"no plan was found after {done} actions: {plan.reason}"
            if plan.steps and self.confirm is not None and not self.confirm(plan.steps[0], plan):
                return f"the next step was not allowed after {done} actions"
            if plan.steps:  # else nothing succeeded from here: search again
                lost = 0 if self._execute_step(plan.steps[0], plan) else lost + 1
                observation = self._observe(plan.steps[0].end, config.max_pulls)
                self.outcomes[-1] = replace(self.outcomes[-1], observed_state=observation.state)
            plan = None
        return f"{self._observed()} after {len(self.outcomes)} actions"

    def _execute_step(self, step: PlanStep, plan: KnotPlan) -> bool:
        """Whether the rope was held all the time."""
        self.outcomes.append(self.executor.execute(step, plan, len(self.outcomes)))
        return self.outcomes[-1].held

    def _observe(self, expected: NDArray, pulls: int = 0) -> Observation:
        """Observe the rope, last seen or `expected` (V, 3); pull it while it is ambiguous."""
        assert self.estimator is not None
        executor, done = self.executor, len(self.outcomes)
        likely = [expected] if executor.points is None else [executor.points, expected]
        self.observation = executor.observe(self.estimator, done, likely)
        for turn in range(pulls):
            if self.observation.points is None or not self._in_doubt():
                break
            if self.allow is not None and not self.allow(
                f"the rope is in doubt: {'; '.join(self.observation.all_ambiguities)}\n"
                f"pull an end {1e3 * PULL_DISTANCE:.0f} mm outward, and look again"
            ):
                break
            executor.pull(done, self.plan.radius, self.observation.ambiguous_ends, turn)
            self.observation = executor.observe(self.estimator, done, likely)
        return self.observation

    def _in_doubt(self) -> bool:
        """Whether the last observation leaves open whether the knot is tied."""
        seen = self.observation
        assert seen is not None
        tied = seen.state in self.plan.goal_states
        return bool(seen.ambiguities or (seen.ambiguous_ends and tied))

    def _tied(self) -> bool | None:
        if self.observation is None:
            return None
        return self.observation.state in self.plan.goal_states and not self._in_doubt()

    def _observed(self) -> str:
        """What the last observation says, in words."""
        seen = self.observation
        assert seen is not None
        reasons = "; ".join(seen.all_ambiguities)
        if self._tied():
            return "the knot is seen to be tied"
        if seen.points is None:
            return f"the rope is not seen: {reasons}"
        state = "that cannot be read" if seen.state is None else seen.state
        words = f"the rope is seen in the state {state}"
        return f"{words}, in doubt: {reasons}" if reasons else words

    def record(self, reason: str) -> Execution:
        """The moves so far, as arrays."""
        moves, unknown = self.executor.moves, np.full(self.plan.start.shape, np.nan)
        gripper, closed, step, references, points = zip(*moves, strict=True) if moves else [()] * 5
        shapes = [
            [unknown if one is None or one.shape != unknown.shape else one for one in part]
            for part in (references, points)
        ]
        reference, tracked = (np.reshape(part, (-1, *unknown.shape)) for part in shapes)
        return Execution(
            times=STEP * np.arange(1, len(moves) + 1, dtype=np.float64),
            gripper=np.reshape(gripper, (-1, 3)),
            closed=np.array(closed, bool),
            step=np.array(step, np.int64),
            reference=reference,
            points=tracked,
            ticks=tuple(self.executor.ticks),
            outcomes=tuple(self.outcomes),
            observation=self.observation,
            tied=self._tied(),
            reason=reason,
        )


@dataclass(frozen=True)
class ControllerSpec:
    """One way to execute a plan."""

    state: str = ""  # where the rope's state is from: vision, or none
    tracks: bool = False  # whether MPPI corrects the drag
    replans: bool = False  # after each action


CONTROLLERS = {
    "open_loop": ControllerSpec(),
    "mppi": ControllerSpec("vision", tracks=True),
    "replan": ControllerSpec("vision", replans=True),
    "mppi_replan": ControllerSpec("vision", tracks=True, replans=True),
}
"""By the names that tables give them."""


@dataclass(frozen=True)
class Trial:
    """An execution judged by the truth."""

    execution: Execution
    tied: bool  # whether the rope truly lies in a goal state
    cause: str  # see `failure_cause`
    deviation: float  # mean distance of the dragged rope's vertices from the plan's, metres, or NaN


def run_trial(
    plan: KnotPlan,
    goal: Goal,
    twin: Twin,
    spec: ControllerSpec,
    config: ExecutionConfig | None = None,
    replan: Replan | None = None,
    camera: Camera | None = None,
    weights: Path = SHIPPED_DYNAMICS,
    network: StrandNetwork | None = None,
    robot: Robot | None = None,
) -> Trial:
    """Execute a plan from a twin's first rope on the twin, which is then used up.

    With vision the twin has a `camera`, here at its nominal pose; `weights` are of the learned
    dynamics, `network` proposes first guesses at the rope in an image, and `robot` is the twin's or
    a wrapper of it, such as one of `FAULTS`.
    """
    source = estimator = controller = None
    if camera is not None:
        simulation = SimulationConfig(rope=twin.config.rope, threads=1)
        prediction = ModelPrediction(MujocoDynamics(simulation))
        tracker = Tracker(camera, simulation.rope, plan.start, prediction, network=network)
        source = TrackedRope(tracker)
        estimator = ImageStateEstimator(camera, simulation.rope, network=network, tracker=tracker)
    if spec.tracks:
        from knotflow.execution.lstm_dynamics import LstmDynamics
        from knotflow.execution.mppi import Mppi

        controller = Mppi(LstmDynamics.load(weights))
    replan, robot = replan if spec.replans else None, robot or twin.robot()
    execution = execute(plan, robot, config, source, controller, estimator, replan)
    truth = np.reshape(twin.trajectory, execution.reference.shape)
    away = np.linalg.norm(execution.reference - truth, axis=-1)
    dragged = away[np.isfinite(away).all(axis=1)]
    cause = failure_cause(execution, goal, twin)
    return Trial(execution, not cause, cause, float(dragged.mean()) if len(dragged) else np.nan)


def failure_cause(execution: Execution, goal: Goal, twin: Twin) -> str:
    """Why a knot is not tied: the first of these causes that applies; empty where it is tied."""
    truth, seen, last = state_or_none(twin.points), execution.observation, execution.outcomes[-1:]
    if truth in goal.states:
        return ""
    if seen is not None and seen.points is None:
        return "rope not seen"
    if seen is not None and seen.state != truth:
        return "state misread"
    if seen is not None and seen.ambiguities:
        return "state in doubt"
    if any(not one.tracked for one in last):
        return "track lost"
    if twin.missed_grasps if seen is None else any(not one.held for one in last):
        return "grasp missed"
    if truth is None or truth not in goal.dag:
        return "out of the DAG"
    return "action failed"

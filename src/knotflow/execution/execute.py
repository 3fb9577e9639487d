"""A plan executed by a robot: step by step as planned, or planned anew after each (Sec. VI).

Between two actions the loop is closed by a look at the rope and a new plan from there: with splines
for the rope as it lies, whether the action led to its state, to another one of the solution DAG, or
outside of it, from where a planner that may undo has a way back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.follow import Controller, ExecutionConfig, Run, Tick
from knotflow.execution.robot import Robot
from knotflow.execution.rope_motions import STEP
from knotflow.execution.sight import Look, RopeSource, Sight
from knotflow.planning import KnotPlan, PlanStep, UnreachableGoalError
from knotflow.simulation import ShapeError
from knotflow.topology import Action, DegenerateCurveError, TopologicalState

Replan = Callable[[NDArray], KnotPlan]
"""Plans the rest of a knot from a rope (V, 3) as it lies, such as `planning.plan_knot` does."""


@dataclass(frozen=True)
class StepOutcome:
    """What became of one step.

    Attributes:
        step: as it was planned.
        found: the state that was seen after it; None where nobody looked, or it cannot be read.
        held: whether the rope was held until it was let go, as far as that was watched.
        followed: whether it then was where it was followed to, as far as it was followed.
    """

    step: PlanStep
    found: TopologicalState | None
    held: bool
    followed: bool

    @property
    def action(self) -> Action:
        """What it was for; an `Arrange` keeps the state."""
        return self.step.action

    @property
    def expected(self) -> TopologicalState:
        """The state it leads to."""
        return self.step.end_state


@dataclass(frozen=True, eq=False)
class Execution:
    """What was commanded and seen; a frame after each of the robot's N moves.

    Attributes:
        times: (N,) seconds since the first move began.
        gripper: (N, 3) where it was commanded to be, metres.
        closed: (N,) whether the fingers were commanded to be closed.
        step: (N,) how many actions had been begun before.
        reference: (N, V, 3) the rope of the plan, metres; NaN where the gripper does not drag.
        points: (N, V, 3) the rope as it was followed, metres; NaN where it was not.
        ticks: what each move that the controller chose took.
        outcomes: of each step, in the order executed.
        sight: the last look at the rope; None where nobody looked.
        tied: whether that look shows a state of the goal, and no doubt; None where nobody looked.
        reason: why it ended.
    """

    times: NDArray[np.float64]
    gripper: NDArray[np.float64]
    closed: NDArray[np.bool_]
    step: NDArray[np.int64]
    reference: NDArray[np.float64]
    points: NDArray[np.float64]
    ticks: tuple[Tick, ...]
    outcomes: tuple[StepOutcome, ...]
    sight: Sight | None
    tied: bool | None
    reason: str


def execute(
    plan: KnotPlan,
    robot: Robot,
    config: ExecutionConfig | None = None,
    source: RopeSource | None = None,
    controller: Controller | None = None,
    look: Look | None = None,
    replan: Replan | None = None,
) -> Execution:
    """Tie the plan's knot.

    Args:
        plan: with the trajectories of its steps.
        robot: used by the words of `Robot` alone.
        config: heights, speeds, what matters, and when to give up.
        source: follows the rope while it is dragged, so that a rope that is lost is noticed.
        controller: corrects the drag. Without one, but with a source, the spline begins where the
            rope is and is then followed blindly.
        look: reads the rope's state at the end, and with `replan` after each action.
        replan: plans the rest after each action. Only the first step of each plan is executed, also
            of one that comes near the goal only; the given plan's if the rope is seen to lie in the
            state it begins with.

    Returns:
        What was done, and whether the knot is seen to be tied.

    Raises:
        ValueError: a controller without a source, `replan` without a look, or a plan without
            trajectories.
    """
    if controller is not None and source is None:
        raise ValueError("a controller needs a source that follows the rope")
    if replan is not None and look is None:
        raise ValueError("planning anew needs a look at the rope after each action")
    if any(len(step.trajectory) == 0 for step in plan.steps):
        raise ValueError("the plan was saved without trajectories, so there is nothing to follow")
    corrects = source is not None or replan is not None
    run = Run(robot, config or ExecutionConfig(), source, controller, corrects)
    knot = _Knot(run, plan, look)
    try:
        reason = knot.follow() if replan is None else knot.tie(replan)
    finally:
        robot.release()
    return knot.record(reason)


@dataclass(eq=False)
class _Knot:
    """A knot in the making."""

    run: Run
    plan: KnotPlan
    look: Look | None
    outcomes: list[StepOutcome] = field(default_factory=list)
    sight: Sight | None = None

    def follow(self) -> str:
        """Execute every step of the plan; why it ended."""
        attempts = self.run.config.attempts
        for number, step in enumerate(self.plan.steps):
            if not any(self._step(step, self.plan) for _ in range(attempts)):
                reason = f"the rope was lost in all {attempts} attempts at step {number}"
                break
        else:
            reason = "every step was executed"
        if self.look is None:
            return reason
        self._see(self.look, self.plan.steps[-1].end if self.plan.steps else self.plan.start)
        return f"{reason}, and {self._seen()}"

    def tie(self, replan: Replan) -> str:
        """Plan, execute one step, look, and so on; why it ended.

        Nothing is planned from a sight in doubt: the planner would tie a rope that is not there.
        Where only an end is in doubt, the shape is right within millimetres, and it can be planned
        from; but a knot that hangs on such an end is not reported. A search that found no plan in
        its time leads some way: its first step is executed, and the rest searched for from there.
        """
        assert self.look is not None
        config, lost, unsolved = self.run.config, 0, 0
        sight = self._see(self.look, self.plan.start, config.pulls)
        begins = self.plan.solved and sight.state == self.plan.start_state
        plan = self.plan if begins else None
        while sight.points is not None and not self._tied():
            done = len(self.outcomes)
            if self._in_doubt():
                return f"it cannot be planned after {done} actions: {self._seen()}"
            if lost == config.attempts:
                return f"the rope was lost in {lost} actions one after the other: {self._seen()}"
            if done == config.max_actions:
                return f"the knot is not tied after {done} actions: {self._seen()}"
            try:
                plan = plan or replan(sight.points)
            except (UnreachableGoalError, DegenerateCurveError, ShapeError) as error:
                return f"there is no plan after {done} actions: {error}"
            unsolved = 0 if plan.solved else unsolved + 1
            if unsolved > config.unsolved or (plan.solved and not plan.steps):
                return f"no plan was found after {done} actions: {plan.reason}"
            if not plan.steps:  # nothing succeeded from here: search again
                plan = None
                continue
            lost = 0 if self._step(plan.steps[0], plan) else lost + 1
            sight = self._see(self.look, plan.steps[0].end, config.pulls)
            self.outcomes[-1] = replace(self.outcomes[-1], found=sight.state)
            plan = None
        return f"{self._seen()} after {len(self.outcomes)} actions"

    def _step(self, step: PlanStep, plan: KnotPlan) -> bool:
        dragged = self.run.execute(step, plan, len(self.outcomes))
        self.outcomes.append(StepOutcome(step, None, dragged.held, dragged.followed))
        return dragged.held

    def _see(self, look: Look, expected: NDArray, pulls: int = 0) -> Sight:
        """What a look shows, that may be where the rope was seen last, or what is expected.

        A rope in doubt is pulled so often, at one end and the other, and so is the end that a knot
        hangs on. What was seen of it then is no evidence of how it lies now.
        """
        run, done = self.run, len(self.outcomes)
        likely = [expected] if run.points is None else [run.points, expected]
        self.sight = run.see(look, done, likely)
        for turn in range(pulls):
            if self.sight.points is None or not self._in_doubt():
                break
            run.pull(done, self.sight.ends, turn)
            self.sight = run.see(look, done, likely)
        return self.sight

    def _in_doubt(self) -> bool:
        """Whether the last look leaves open what has to be known: whether the knot is tied."""
        sight = self.sight
        assert sight is not None
        return bool(sight.doubts or (sight.ends and sight.state in self.plan.goal_states))

    def _tied(self) -> bool | None:
        if self.sight is None:
            return None
        return self.sight.state in self.plan.goal_states and not self._in_doubt()

    def _seen(self) -> str:
        """What the last look says, in words."""
        sight = self.sight
        assert sight is not None
        doubts = "; ".join(sight.in_doubt)
        if self._tied():
            return "the knot is seen to be tied"
        if sight.points is None:
            return f"the rope is not seen: {doubts}"
        state = "that cannot be read" if sight.state is None else sight.state
        seen = f"the rope is seen in the state {state}"
        return f"{seen}, in doubt: {doubts}" if doubts else seen

    def record(self, reason: str) -> Execution:
        """All that was done."""
        frames, unknown = self.run.frames, np.full(self.plan.start.shape, np.nan)
        references = [unknown if one.reference is None else one.reference for one in frames]
        points = [unknown if one.points is None else one.points for one in frames]
        return Execution(
            times=STEP * np.arange(1, len(frames) + 1, dtype=np.float64),
            gripper=np.reshape([one.gripper for one in frames], (-1, 3)),
            closed=np.array([one.closed for one in frames], bool),
            step=np.array([one.step for one in frames], np.int64),
            reference=np.reshape(references, (-1, *unknown.shape)),
            points=np.reshape(points, (-1, *unknown.shape)),
            ticks=tuple(self.run.ticks),
            outcomes=tuple(self.outcomes),
            sight=self.sight,
            tied=self._tied(),
            reason=reason,
        )

"""A plan to tie a knot: what a search found, or how far it came and why it stopped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning import plan_file
from knotflow.planning.plan_step import PlanStep, Tried
from knotflow.planning.waypoints import GripperConfig, Waypoints, trace_waypoints
from knotflow.topology import Action, Arrange, TopologicalState


@dataclass(frozen=True, eq=False)
class KnotPlan:
    """What `plan_knot` returns.

    Attributes:
        goal: what was asked for: a knot's name, a state or a path.
        goal_states: the states in which that knot is tied.
        solved: whether the last step ends in one of them.
        reason: why the search stopped.
        start: (V, 3) the rope at rest before the first step, metres.
        start_state: its topological state.
        steps: to the goal or, not solved, to the node of the tree nearest to it; maybe none.
        tried: a summary of all branches.
        branches: simulated splines, the paper's measure of a search.
        nodes: nodes of the search tree, its root included.
        seconds: wall time of the search, of which
        sampling_seconds: in the sampler, beside which the simulator may be at work, and
        simulation_seconds: in the simulator after it.
        radius: of the rope, metres.
        move_time: from grasp to release of each spline, seconds.
    """

    goal: str
    goal_states: tuple[TopologicalState, ...]
    solved: bool
    reason: str
    start: NDArray[np.float64]
    start_state: TopologicalState
    steps: tuple[PlanStep, ...]
    tried: tuple[Tried, ...]
    branches: int
    nodes: int
    seconds: float
    sampling_seconds: float
    simulation_seconds: float
    radius: float
    move_time: float

    @property
    def actions(self) -> tuple[Action, ...]:
        """The topological path: what the steps do, arranging left out."""
        return tuple(step.action for step in self.steps if not isinstance(step.action, Arrange))

    @property
    def splines(self) -> NDArray[np.float64]:
        """(n, 6) the spline of each step."""
        return np.array([step.spline for step in self.steps]).reshape(-1, 6)

    @property
    def controls(self) -> NDArray[np.float64]:
        """(n, 3, 3) the control points of each step's spline, metres."""
        return np.array([step.controls(self.radius) for step in self.steps]).reshape(-1, 3, 3)

    @property
    def shapes(self) -> NDArray[np.float64]:
        """(n + 1, V, 3) the rope at rest: start, between steps, and final, metres."""
        return np.stack([self.start, *(step.end for step in self.steps)])

    @property
    def states(self) -> tuple[TopologicalState, ...]:
        """The n + 1 topological states of `shapes`."""
        return (self.start_state, *(step.end_state for step in self.steps))

    def summary(self) -> str:
        """A line a state: the topological path with the tree's size, for printing."""
        steps = [("start", self.start_state)]
        steps += [(str(step.action), step.end_state) for step in self.steps]
        width = max(10, *(len(action) for action, _ in steps))
        lines = [f"{action:<{width}} {state}" for action, state in steps]
        outcome = f"{self.goal}: tied" if self.solved else f"{self.goal}: NOT tied"
        lines.append(
            f"{outcome} ({self.reason}); {self.branches} branches, {self.nodes} nodes, "
            f"{self.seconds:.2f} s"
        )
        if not self.solved:
            lines += [f"  {line}" for line in self._tried_lines()]
        return "\n".join(lines)

    def waypoints(self, rate_hz: float = 20.0, config: GripperConfig | None = None) -> Waypoints:
        """Timed gripper waypoints with open and close, for a robot to execute.

        Args:
            rate_hz: waypoints per second.
            config: heights and speeds between the splines.

        Raises:
            ValueError: a rate that is not above 0, or heights at which the gripper would touch the
                rope on its way.
        """
        grippers = [(step.times, step.gripper, str(step.action)) for step in self.steps]
        return trace_waypoints(
            grippers, self.shapes, self.radius, self.move_time, rate_hz, config or GripperConfig()
        )

    def to_json(self, trajectories: bool = True) -> str:
        """The plan as JSON text; `from_json` reads it back.

        Shapes and splines keep all their digits, trajectories are rounded to micrometres. Without
        `trajectories` a step keeps its frames' times and gripper only.
        """
        return plan_file.dump(vars(self), trajectories)

    @classmethod
    def from_json(cls, text: str) -> KnotPlan:
        """Read what `to_json` wrote.

        Raises:
            PlanFormatError: not a plan, one of another version, or one with parts missing.
        """
        return cls(**plan_file.load(text))

    def _tried_lines(self) -> list[str]:
        total: dict[tuple[TopologicalState, Action], list[int]] = {}
        for tried in self.tried:
            counts = total.setdefault((tried.state, tried.action), [0, 0])
            counts[0] += tried.branches
            counts[1] += tried.branches * tried.success
        return [
            f"{action} from {state}: {successes} of {branches} branches reached its state"
            for (state, action), (branches, successes) in sorted(
                total.items(), key=lambda item: (item[0][0], str(item[0][1]))
            )
        ] or ["nothing was tried"]

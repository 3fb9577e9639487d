"""What is to be tied into which ropes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning import Goal, SolutionDag, parse_goal
from knotflow.simulation import RopeConfig, StartsConfig, check_points, random_curve
from knotflow.topology import Action, TopologicalState, parse_action


@dataclass(frozen=True)
class TieTask:
    """A goal, the ropes it is to be reached from, and how many splines that may take.

    Made by `TieTask.tie` or `TieTask.single`.
    """

    goal: Goal
    """The states that count as success, and the solution DAG that leads there."""
    splines: int
    """Splines in an episode, at most."""
    starts: NDArray[np.float64] | None = None
    """(N, V, 3) ropes at rest, metres; None draws a random curve for every episode."""
    action: Action | None = None
    """The one action that is asked for; None where any path of the solution DAG will do."""

    @classmethod
    def tie(cls, goal: str, starts: NDArray | None = None, splines: int = 10) -> TieTask:
        """Tie a goal, by any path of its solution DAG.

        Args:
            goal: a knot's name, a state, or a path of actions; see `planning.parse_goal`.
            starts: (N, V, 3) metres, each in some state of the DAG; None for random curves.
            splines: in an episode, at most.

        Raises:
            ValueError: a text that names no goal, fewer than one spline, or unfit starts.
        """
        return cls(parse_goal(goal), splines, _checked(starts))._check()

    @classmethod
    def single(cls, action: str | Action, starts: NDArray | None = None) -> TieTask:
        """Reach the state after one given action, with one spline.

        Args:
            action: such as "C(2,0,1)".
            starts: (N, V, 3) metres, all in one state, which allows the action; None for random
                curves. `simulation.reached` makes starts in other states.

        Raises:
            IllegalActionError: the state of the starts does not allow the action.
            ValueError: a text that is no action, or unfit starts.
        """
        action = parse_action(action) if isinstance(action, str) else action
        starts = _checked(starts)
        state = TopologicalState.trivial()
        if starts is not None:
            state = TopologicalState.from_curve(starts[0])
        goal = Goal(str(action), SolutionDag.along([action], state))
        return cls(goal, 1, starts, action)._check()

    def start(
        self, rng: np.random.Generator, rope: RopeConfig, index: int | None = None
    ) -> NDArray[np.float64]:
        """A rope (V, 3) to begin with: the one of an index, or one that is drawn.

        Raises:
            ShapeError: the starts are not shapes of this rope.
            ValueError: there is no start of this index.
        """
        if index is not None and not 0 <= index < (0 if self.starts is None else len(self.starts)):
            has = "draws random curves" if self.starts is None else f"has {len(self.starts)} starts"
            raise ValueError(f"there is no start {index}: the task {has}")
        if self.starts is None:
            return random_curve(rope, rng, StartsConfig())
        return check_points(
            self.starts[rng.integers(len(self.starts)) if index is None else index], rope
        )

    def actions(self, state: TopologicalState | None) -> tuple[Action, ...]:
        """What leads on towards the goal from a state; nothing from a goal or off the DAG."""
        if state is None or state not in self.goal.dag or state in self.goal.states:
            return ()
        return tuple(action for action, _ in self.goal.dag.edges_from(state))

    def _check(self) -> TieTask:
        if self.splines < 1:
            raise ValueError(f"an episode has at least 1 spline, got {self.splines}")
        for points in () if self.starts is None else self.starts:
            self.goal.dag.check_start(TopologicalState.from_curve(points))
        return self


def _checked(starts: NDArray | None) -> NDArray[np.float64] | None:
    if starts is None:
        return None
    starts = np.asarray(starts, np.float64)
    if starts.ndim != 3 or starts.shape[-1] != 3 or not len(starts):
        raise ValueError(f"starts have shape (N, V, 3) with N >= 1, got {starts.shape}")
    return starts

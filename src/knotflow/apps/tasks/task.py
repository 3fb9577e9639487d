"""Tying tasks, and their goals, actions and splines as arrays."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning import Goal, SolutionDag, parse_goal
from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeConfig,
    StartsConfig,
    check_points,
    clip_splines,
    random_curve,
)
from knotflow.topology import R1, R2, Action, Cross, TopologicalState, parse_action

KINDS = (R1, R2, Cross)  # in an action's code counted from 1, and 0 for any action
ACTION_SIZE = 5  # the kind, and as many parameters as an R2 has


@dataclass(frozen=True)
class TieTask:
    """A goal, the ropes it is to be reached from, and how many splines that may take."""

    goal: Goal  # the states that count as success, and the solution DAG that leads there
    splines: int  # splines in an episode, at most
    starts: NDArray[np.float64] | None = None
    """(N, V, 3) ropes at rest, metres; None draws a random curve for every episode."""
    action: Action | None = None
    """The one action that is asked for; None where any path of the solution DAG will do."""

    def __post_init__(self) -> None:
        if self.splines < 1:
            raise ValueError(f"an episode has at least 1 spline, got {self.splines}")
        for points in () if self.starts is None else _checked(self.starts):
            self.goal.dag.check_start(TopologicalState.from_curve(points))

    @classmethod
    def tie(cls, goal: str, starts: NDArray | None = None, splines: int = 10) -> TieTask:
        """Tie a goal, see `planning.parse_goal`, by any path of its solution DAG.

        The starts (N, V, 3), metres, are each in some state of the DAG; None for random curves.

        Raises:
            ValueError: a text that names no goal, fewer than one spline, or unfit starts.
        """
        return cls(parse_goal(goal), splines, None if starts is None else np.asarray(starts, float))

    @classmethod
    def single(cls, action: str | Action, starts: NDArray | None = None) -> TieTask:
        """Reach the state after one given action, such as "C(2,0,1)", with one spline.

        The starts (N, V, 3), metres, are all in one state; None for random curves.

        Raises:
            IllegalActionError: the state of the starts does not allow the action.
            ValueError: a text that is no action, or unfit starts.
        """
        action = parse_action(action) if isinstance(action, str) else action
        state = TopologicalState.trivial()
        if starts is not None:
            starts = np.asarray(starts, float)
            state = TopologicalState.from_curve(_checked(starts)[0])
        goal = Goal(str(action), SolutionDag.along([action], state))
        return cls(goal, 1, starts, action)

    def start(
        self, rng: np.random.Generator, rope: RopeConfig, index: int | None = None
    ) -> NDArray[np.float64]:
        """A rope (V, 3) to begin with: the one of an index, or one that is drawn.

        Raises:
            ShapeError: the starts are not shapes of this rope.
            ValueError: there is no start of this index.
        """
        if self.starts is None and index is None:
            return random_curve(rope, rng, StartsConfig())
        starts = () if self.starts is None else self.starts
        row = int(rng.integers(len(starts))) if index is None else index
        if not 0 <= row < len(starts):
            raise ValueError(f"there is no start {row}: the task has {len(starts)} starts")
        return check_points(starts[row], rope)

    def actions(self, state: TopologicalState | None) -> tuple[Action, ...]:
        """The actions of the DAG in a state; none in a goal state or off the DAG."""
        if state is None or state not in self.goal.dag or state in self.goal.states:
            return ()
        return tuple(action for action, _ in self.goal.dag.edges_from(state))


def _checked(starts: NDArray[np.float64]) -> NDArray[np.float64]:
    if starts.ndim != 3 or starts.shape[-1] != 3 or not len(starts):
        raise ValueError(f"starts have shape (N, V, 3) with N >= 1, got {starts.shape}")
    return starts


def goal_codes(task: TieTask) -> NDArray[np.int8]:
    """(G, C, 3) the signed Gauss codes of a task's goal states, sorted.

    A row is one crossing (over, under, sign) as in Eq. 1, or zeros.
    """
    states = sorted(task.goal.states)
    most = max(1, *(state.num_crossings for state in states))
    codes = np.zeros((len(states), most, 3), np.int8)
    for code, state in zip(codes, states, strict=True):
        code[: state.num_crossings] = np.reshape(state.crossings, (-1, 3))
    return codes


def action_code(action: Action | None) -> NDArray[np.int8]:
    """(5,) kind and parameters in the paper's order (Table I), filled up with zeros."""
    code = np.zeros(ACTION_SIZE, np.int8)
    if isinstance(action, KINDS):
        parameters = astuple(action)
        code[: 1 + len(parameters)] = 1 + KINDS.index(type(action)), *parameters
    return code


def to_splines(actions: NDArray) -> NDArray[np.float64]:
    """Splines (..., 6), see `simulation.spline`, from actions (..., 6), clipped to [-1, 1]."""
    unit = (np.asarray(actions, np.float64) + 1) / 2
    return clip_splines(SPLINE_LOW + unit * (SPLINE_HIGH - SPLINE_LOW))


def to_box(splines: NDArray) -> NDArray[np.float32]:
    """Actions (..., 6) of [-1, 1] for splines (..., 6): the inverse of `to_splines`."""
    unit = (np.asarray(splines, np.float64) - SPLINE_LOW) / (SPLINE_HIGH - SPLINE_LOW)
    return (2 * unit - 1).astype(np.float32)

"""Evaluation of Causal InfoGAN: goals, reachable ends, measures of plans (Sec. VII-C, Fig. 8)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pandas as pd

from knotflow.samplers.demonstrations import TASKS, Task, task
from knotflow.simulation import Attempts, state_or_none
from knotflow.topology import Action, TopologicalState, segment_lengths
from knotflow.topology.polyline import Floats

PANEL_WAY_POINTS = 6

FOCUS = "C(0,1,1)"
OVERHAND = "overhand"
_LAST = task("C(2,0,1)")


@dataclass(frozen=True)
class ActionSequence:
    """A start state and the actions to execute from there."""

    name: str  # an action, or "overhand"
    first: Task  # whose unseen starts are taken
    actions: tuple[Action, ...]

    @property
    def file(self) -> str:
        """The goal as a file name."""
        return self.first.name if len(self.actions) == 1 else self.name


GOALS: tuple[ActionSequence, ...] = (
    *(ActionSequence(str(one.action), one, (one.action,)) for one in TASKS),
    # The overhand of Sec. VII-A4: R1(0,1,1), C(0,1,1), C(2,0,1).
    ActionSequence(OVERHAND, TASKS[0], (*_LAST.start_actions, _LAST.action)),
)
"""The eight actions of Fig. 6 and the multi-stage overhand."""

Propose = Callable[[Floats, Action, TopologicalState], Attempts]
"""Executes heuristic splines for an action on a rope (V, 3) in a state."""


def reachable_end(
    points: Floats, goal: ActionSequence, propose: Propose, rounds: int
) -> Floats | None:
    """A rope (V, 3) at rest in the goal's state, reached from a start (V, 3) in metres.

    "We guarantee there is a feasible path": heuristic splines are executed until one reaches the
    goal state, at most `rounds` batches for each action.
    """
    batches = iter(range(rounds * len(goal.actions)))

    def reach(points: Floats, state: TopologicalState, actions: Sequence[Action]) -> Floats | None:
        if not actions:
            return points
        # After a success of the action before, at most `rounds` batches; then another is sought.
        for _ in islice(batches, rounds):
            tried = propose(points, actions[0], state)
            if tried.success.any():
                ends = tried.rollouts.end_points[tried.success]
                roomiest = max(ends, key=lambda shape: float(segment_lengths(shape).min()))
                end = reach(roomiest, state.apply(actions[0]), actions[1:])
                if end is not None:
                    return end
        return None

    return reach(points, goal.first.start_state, goal.actions)


@dataclass(frozen=True)
class PlanMeasures:
    """One plan against the shapes it was asked to join."""

    start_distance: float
    """From the given start to its projection, mean over vertices, metres."""
    end_distance: float
    """From the given end to its projection, mean over vertices, metres."""
    start_state: str
    """Of the projected start: "kept" as given, "another", or "unreadable"."""
    end_state: str
    """The same of the projected end."""
    unevenness: float
    """Standard deviation over mean of the steps from the projected start over all way points to
    the projected end, each the mean motion of a vertex; 0 where progress is even."""


def measure(
    start: Floats,
    projected_start: Floats,
    way_points: Floats,
    projected_end: Floats,
    end: Floats,
) -> PlanMeasures:
    """Measures of a plan: way points (steps + 1, V, 3), the other shapes (V, 3), metres."""

    def outcome(projected: Floats, given: Floats) -> str:
        state = state_or_none(projected)
        if state is None:
            return "unreadable"
        return "kept" if state == state_or_none(given) else "another"

    shapes = np.concatenate([projected_start[None], way_points, projected_end[None]])
    steps = np.linalg.norm(np.diff(shapes, axis=0), axis=-1).mean(axis=-1)
    return PlanMeasures(
        start_distance=float(np.linalg.norm(projected_start - start, axis=-1).mean()),
        end_distance=float(np.linalg.norm(projected_end - end, axis=-1).mean()),
        start_state=outcome(projected_start, start),
        end_state=outcome(projected_end, end),
        unevenness=float(steps.std() / steps.mean()) if steps.any() else 0.0,
    )


def panel_rows(
    row: Mapping[str, object],
    start: Floats,
    projected_start: Floats,
    way_points: Floats,
    projected_end: Floats,
    end: Floats,
) -> pd.DataFrame:
    """One line a vertex of the shapes of a plan, some of its way points, in the order of Fig. 8."""
    few = np.unique(np.linspace(0, len(way_points) - 1, PANEL_WAY_POINTS).round().astype(int))
    way_points = way_points[few]
    roles = ["given start", "projected start", *["way point"] * len(way_points)]
    roles += ["projected end", "given end"]
    shapes = np.concatenate(
        [start[None], projected_start[None], way_points, projected_end[None], end[None]]
    )
    columns, vertices = np.indices(shapes.shape[:2])
    table = {key: row[key] for key in ("model", "seed", "goal", "shapes", "start")}
    table |= {"column": columns.ravel(), "role": np.repeat(roles, shapes.shape[1])}
    table |= {"vertex": vertices.ravel()}
    table |= {axis: shapes[..., k].ravel() for k, axis in enumerate("xyz")}
    return pd.DataFrame(table)


def compare(plans: pd.DataFrame, outcomes: pd.DataFrame) -> pd.DataFrame:
    """Trials and successes by method, action, training_seed and start, of starts with an end shape.

    A plan of Causal InfoGAN succeeds if the states of both ends are kept; `outcomes` are of other
    methods (method, training_seed, action, start, success).
    """
    unseen = plans[plans["shapes"] == "unseen"]
    made = pd.DataFrame(
        {
            "method": "causal_infogan_" + unseen["model"],
            "training_seed": unseen["seed"],
            "action": unseen["goal"],
            "start": unseen["start"],
            "success": (unseen[["start_state", "end_state"]] == "kept").all(axis=1),
        }
    )
    asked = made[["action", "start"]].drop_duplicates()
    rows = pd.concat([made, outcomes.merge(asked)]).astype({"success": int})
    by = ["method", "action", "training_seed", "start"]
    counted = rows.groupby(by, sort=False)["success"].agg(["size", "sum"]).reset_index()
    return counted.rename(columns={"size": "trials", "sum": "successes"})

"""The parts of a plan: its executed steps, and what was tried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.simulation import control_points
from knotflow.topology import Action, TopologicalState


@dataclass(frozen=True, eq=False)
class PlanStep:
    """One executed spline; metres and seconds, world frame.

    Attributes:
        action: the topological action it instantiates, or `Arrange`, which keeps the state.
        spline: (6,) see `simulation.spline`.
        start: (V, 3) the rope at rest before.
        start_state: its topological state.
        end: (V, 3) the rope at rest after.
        end_state: its topological state, the one the action leads to.
        times: (T,) of the frames; the first is 0, at the grasp.
        trajectory: (T, V, 3) the rope in simulation.
        gripper: (T, 3) the gripper; it holds the rope for the plan's `move_time`.
    """

    action: Action
    spline: NDArray[np.float64]
    start: NDArray[np.float64]
    start_state: TopologicalState
    end: NDArray[np.float64]
    end_state: TopologicalState
    times: NDArray[np.float64]
    trajectory: NDArray[np.float32]
    gripper: NDArray[np.float32]

    def controls(self, radius: float) -> NDArray[np.float64]:
        """(3, 3) the control points of the spline on a rope of that radius, metres."""
        return control_points(self.start, self.spline, radius)


@dataclass(frozen=True)
class Tried:
    """How often one action was tried from one state with one outcome.

    Attributes:
        state: where the branches began.
        action: what they were for, `Arrange` included.
        outcome: `str` of the state they ended in, "diverged", "unreadable", or "fragile" for the
            action's state that too few ropes of an ensemble reached, or within the margin.
        success: whether that is the action's state.
        branches: how many there were.
    """

    state: TopologicalState
    action: Action
    outcome: str
    success: bool
    branches: int

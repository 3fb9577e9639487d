"""Goals, actions and splines as arrays of fixed size, for networks of any make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotflow.apps.tasks.task import TieTask
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW, clip_splines
from knotflow.topology import R1, R2, Action, Cross

KINDS = (R1, R2, Cross)
"""An action's kind is its place here, counted from 1; 0 says that any action will do."""
ACTION_SIZE = 5
"""The kind, and as many parameters as an R2 has."""


def goal_codes(task: TieTask) -> NDArray[np.int8]:
    """(G, C, 3) the signed Gauss codes of a task's goal states, sorted.

    A row is one crossing (over, under, sign) as in Eq. 1, positions counted from 1; states of fewer
    than C crossings are filled up with zeros.
    """
    states = sorted(task.goal.states)
    codes = np.zeros((len(states), max(1, *(s.num_crossings for s in states), 1), 3), np.int8)
    for code, state in zip(codes, states, strict=True):
        code[: state.num_crossings] = state.crossings or np.zeros((0, 3))
    return codes


def action_code(action: Action | None) -> NDArray[np.int8]:
    """(5,) kind and parameters in the paper's order (Table I), filled up with zeros.

    No action at all is five zeros.
    """
    code = np.zeros(ACTION_SIZE, np.int8)
    for kind, cls in enumerate(KINDS, 1):
        if isinstance(action, cls):
            parameters = str(action).partition("(")[2].rstrip(")").split(",")
            code[: 1 + len(parameters)] = [kind, *map(int, parameters)]
    return code


def to_splines(actions: NDArray) -> NDArray[np.float64]:
    """Splines (..., 6) from actions (..., 6) of [-1, 1]: see `simulation.spline` for their units.

    What lies outside is brought to the edge.
    """
    unit = (np.asarray(actions, np.float64) + 1) / 2
    return clip_splines(SPLINE_LOW + unit * (SPLINE_HIGH - SPLINE_LOW))


def to_box(splines: NDArray) -> NDArray[np.float32]:
    """Actions (..., 6) of [-1, 1] for splines (..., 6): the inverse of `to_splines`."""
    unit = (np.asarray(splines, np.float64) - SPLINE_LOW) / (SPLINE_HIGH - SPLINE_LOW)
    return (2 * unit - 1).astype(np.float32)

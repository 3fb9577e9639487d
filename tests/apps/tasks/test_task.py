"""A task's goal, actions and starts, and their arrays."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.apps.tasks import TieTask, action_code, goal_codes
from knotflow.simulation import RopeConfig, straight
from knotflow.topology import KNOT_NAMES, R1, R2, Cross, TopologicalState, knot, parse_action

ROPE = straight(RopeConfig())


@pytest.mark.parametrize("name", ["overhand", "figure_eight", "pentagram"])
def test_goal_codes_are_states(name):
    codes = goal_codes(TieTask.tie(name))
    read = {
        TopologicalState.from_crossings([tuple(map(int, row)) for row in code if row.any()])
        for code in codes
    }
    assert read == knot(name) and name in KNOT_NAMES


def test_action_codes_hold_parameters():
    actions = [R1(0, 1, 1), R1(0, 1, -1), R2(0, 0, 1, 1), Cross(2, 0, 1), None]
    codes = [tuple(action_code(action).tolist()) for action in actions]
    assert len(set(codes)) == len(codes)
    assert codes[2] == (2, 0, 0, 1, 1) and codes[3] == (3, 2, 0, 1, 0) and not any(codes[4])


def test_actions_follow_the_dag():
    task = TieTask.tie("overhand")
    state = TopologicalState.trivial()
    while state not in task.goal.states:
        state = state.apply(task.actions(state)[0])
    assert task.actions(state) == ()
    assert task.actions(None) == ()
    assert task.actions(TopologicalState.trivial().apply(R2(0, 0, 1, 1))) == ()


def test_single_action_has_one_goal():
    task = TieTask.single("R1(0,1,1)", [ROPE.tolist()])
    assert task.goal.states == {TopologicalState.trivial().apply(parse_action("R1(0,1,1)"))}
    assert task.splines == 1


def test_unfit_starts_and_goals_are_refused():
    with pytest.raises(ValueError, match=r"shape \(N, V, 3\)"):
        TieTask.tie("overhand", ROPE)
    with pytest.raises(ValueError, match="segment"):
        TieTask.single("C(2,0,1)", ROPE[None])
    with pytest.raises(ValueError, match="at least 1 spline"):
        TieTask.tie("overhand", splines=0)
    with pytest.raises(ValueError, match="no start 4: the task has 1"):
        TieTask.tie("overhand", ROPE[None]).start(np.random.default_rng(0), RopeConfig(), 4)

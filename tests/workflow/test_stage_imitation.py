"""What each primitive learns from, whoever demonstrated which actions."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.samplers.demonstrations import TASKS, load_demonstrations
from knotflow.simulation import Trials
from knotflow.topology import parse_action
from knotflow.workflow.stages.imitation import demonstrated, tasks_of


@pytest.fixture(scope="module")
def trials():
    """Of each shipped demonstration one spline, by action, in the file's order."""
    shown = {}
    for one in load_demonstrations():
        action, points, spline = one.task.action, one.points[None], one.spline[None]
        own = Trials(action, one.task.start_state, points, spline, np.ones(1, bool))
        shown.setdefault(action, []).append(own)
    return shown


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_primitive_learns_its_tasks_in_their_order(trials, number):
    chosen = demonstrated(number, trials)
    assert list(chosen) == [task.action for task in tasks_of(number)]
    assert all(len(some) == len(trials[action]) for action, some in chosen.items())


def test_actions_beyond_the_eight_are_learned_too(trials):
    straight = trials[TASKS[0].action]
    other = parse_action("R1(0,-1,1)")
    more = trials | {other: [replace(one, action=other) for one in straight]}
    assert other in demonstrated(1, more)


def test_a_file_without_an_action_of_a_primitive_says_so(trials):
    with pytest.raises(ValueError, match=r"primitive 2, which learns R2\(0,0,1,1\) .*merge"):
        demonstrated(2, {TASKS[0].action: trials[TASKS[0].action]})

"""What each primitive learns from, whoever demonstrated which actions."""

import numpy as np
import pytest

from knotflow.samplers.demonstrations import TASKS, Trials, load_demonstrations
from knotflow.topology import parse_action
from knotflow.workflow.stages.imitation import demonstrated, tasks_of


@pytest.fixture(scope="module")
def trials():
    """Of each shipped action two start shapes, with a spline each, in the file's order."""
    shown = {}
    for one in load_demonstrations():
        shown.setdefault(one.task.action, []).append(one)
    return {action: trials_of(action, some[:2]) for action, some in shown.items()}


def trials_of(action, some):
    return Trials(
        action,
        np.stack([one.points for one in some]),
        np.arange(len(some)),
        np.stack([one.spline for one in some]),
        np.ones(len(some), bool),
    )


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_primitive_learns_its_tasks_in_their_order(trials, number):
    chosen = demonstrated(number, trials)
    assert list(chosen) == [task.action for task in tasks_of(number)]
    assert all(len(some) == len(trials[action]) for action, some in chosen.items())


def test_actions_beyond_the_eight_are_learned_too(trials):
    straight = trials[TASKS[0].action]
    other = parse_action("R1(0,-1,1)")
    more = trials | {other: Trials(other, *list(vars(straight).values())[1:])}
    assert other in demonstrated(1, more)


def test_trials_from_some_starts_keep_their_shapes(trials):
    some = trials[TASKS[2].action]
    (only,) = some.from_starts(np.array([1])).starts
    assert np.array_equal(only, some.starts[1])
    assert some.from_starts(np.array([1])).start.tolist() == [0]
    assert np.array_equal(some.from_starts(np.array([0, 1])).splines, some.splines)


def test_a_file_without_an_action_of_a_primitive_says_so(trials):
    with pytest.raises(ValueError, match=r"primitive 2, which learns R2\(0,0,1,1\) .*merge"):
        demonstrated(2, {TASKS[0].action: trials[TASKS[0].action]})

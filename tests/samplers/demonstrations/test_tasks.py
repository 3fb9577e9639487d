"""The eight actions of Fig. 6 and where they start."""

import pytest

from knotflow.samplers.demonstrations import TASKS, task
from knotflow.topology import knot

STARTS = {
    "R1(0,1,1)": 0,
    "R2(0,0,1,1)": 0,
    "C(0,1,1)": 1,
    "C(0,2,1)": 1,
    "C(4,2,1)": 2,
    "C(1,2,1)": 1,
    "C(2,0,1)": 2,
    "C(2,4,1)": 2,
}


def test_they_are_those_of_the_design_in_the_order_of_the_figure():
    assert {str(one.action): one.start_state.num_crossings for one in TASKS} == STARTS
    assert list(STARTS) == [str(one.action) for one in TASKS]


def test_two_of_them_end_in_the_overhand():
    overhand = knot("overhand")
    assert {str(one.action) for one in TASKS if one.goal_state in overhand} >= {
        "C(4,2,1)",
        "C(2,0,1)",
    }


def test_names_are_file_names_and_differ():
    names = {one.name for one in TASKS}
    assert len(names) == 8
    assert all(name.isidentifier() for name in names)


def test_unknown_actions_are_answered_with_the_valid_ones():
    assert task("C(2,0,1)") is TASKS[6]
    with pytest.raises(ValueError, match=r"'C\(9,9,1\)'; the eight are R1\(0,1,1\), R2"):
        task("C(9,9,1)")

"""The shipped demonstrations, and files that are none."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from knotflow.samplers.demonstrations import (
    SHIPPED,
    TASKS,
    Demonstration,
    DemonstrationError,
    add_demonstration,
    load_demonstrations,
    merge_demonstrations,
    save_demonstrations,
    task,
    task_at,
)
from knotflow.simulation import RopeConfig, check_points, check_splines, resample
from knotflow.topology import TopologicalState, knot, parse_action


@pytest.fixture(scope="module")
def shipped():
    return load_demonstrations()


def test_fifty_are_shipped_and_say_who_made_them(shipped):
    assert len(shipped) == 50
    counts = Counter(str(one.task.action) for one in shipped)
    assert counts == {str(task.action): 8 if task.start_actions else 1 for task in TASKS}
    assert {one.source for one in shipped} == {"scripted"}


def test_each_starts_in_the_state_of_its_task(shipped):
    rope = RopeConfig()
    for one in shipped:
        points = resample(one.points, rope)
        check_points(points, rope)
        check_splines(one.spline)
        assert TopologicalState.from_curve(points) == one.task.start_state


def test_what_is_saved_is_read_back(shipped, tmp_path):
    path = tmp_path / "mine.jsonl"
    save_demonstrations(path, shipped[:3])
    again = load_demonstrations(path)
    for one, other in zip(shipped[:3], again, strict=True):
        assert one.task == other.task
        assert one.source == other.source
        assert np.array_equal(one.points, other.points)
        assert np.array_equal(one.spline, other.spline)


def test_a_file_of_something_else_is_refused(tmp_path):
    (tmp_path / "rope.csv").write_text("x,y,z\n0,0,0\n")
    with pytest.raises(DemonstrationError, match="line 1: not JSON, .* as the studio writes them"):
        load_demonstrations(tmp_path / "rope.csv")


def test_output_of_the_demonstrator_is_read(shipped, tmp_path):
    save_demonstrations(tmp_path / "scripted.jsonl", shipped[:2])
    assert [one.task for one in load_demonstrations(tmp_path)] == [one.task for one in shipped[:2]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"action": "C(7,7,1)"}, r"line 1: no demonstrated action is called"),
        ({"spline": [2, 0, 0, 0.1, 0, 0]}, r"line 1: spline\[\] has grasp = 2"),
        ({"spline": [1, 2]}, r"line 1: splines have shape"),
        ({"spline": [[0.5, 0, 0, 0.1, 0, 0]] * 2}, r"line 1: .* one spline, .* not \(2, 6\)"),
        ({"points": [[0, 0]]}, r"line 1: a rope shape is \(V, 3\) points"),
        ({"points": "here"}, r"line 1"),
        ({"source": None}, r"line 1: 'source' is missing"),
        ({"start": ["C(0,1,1)"]}, r"line 1: "),
        ({"who": 7}, r"line 1: who must be a name, got 7"),
        ({"when": "yesterday"}, r"line 1: .*'yesterday'"),
        (
            {"action": "C(0,1,1)"},
            r"line 1: the points, head first, are in state trivial, but C\(0,1,1\) .* from 2o1\+",
        ),
    ],
)
def test_a_wrong_line_is_named(tmp_path, change, message):
    row = json.loads(SHIPPED.read_text().splitlines()[0]) | change
    row = {key: value for key, value in row.items() if value is not None}
    path = tmp_path / "wrong.jsonl"
    path.write_text(json.dumps(row) + "\n")
    with pytest.raises(DemonstrationError, match=message):
        load_demonstrations(path)


def test_a_rope_given_tail_first_is_refused(shipped, tmp_path):
    loop = next(one for one in shipped if one.task.start_actions)
    path = tmp_path / "reversed.jsonl"
    save_demonstrations(path, [shipped[0], replace(loop, points=loop.points[::-1])])
    with pytest.raises(DemonstrationError, match="line 2: the points, head first"):
        load_demonstrations(path)


def test_empty_lines_at_the_end_are_passed_over(shipped, tmp_path):
    path = tmp_path / "edited.jsonl"
    save_demonstrations(path, shipped[:2])
    path.write_text(path.read_text() + "\n\n")
    assert len(load_demonstrations(path)) == 2


def test_a_line_that_is_no_json_is_named(tmp_path):
    path = tmp_path / "wrong.jsonl"
    path.write_text(SHIPPED.read_text().splitlines()[0] + "\n{oops\n")
    with pytest.raises(DemonstrationError, match="line 2"):
        load_demonstrations(path)


def test_the_shipped_file_is_what_saving_it_writes(shipped, tmp_path):
    save_demonstrations(tmp_path / "again.jsonl", shipped)
    assert (tmp_path / "again.jsonl").read_text() == SHIPPED.read_text()


@pytest.mark.parametrize(
    ("start", "action"),
    [((), "R1(0,-1,1)"), (("R1(0,1,1)",), "R2(1,1,1,1)"), (("R2(0,0,1,1)",), "C(0,2,1)")],
)
def test_any_legal_action_can_be_demonstrated_and_signed(
    shipped, shape_of, tmp_path, start, action
):
    state = TopologicalState.trivial()
    for one in start:
        state = state.apply(parse_action(one))
    try:
        one = task_at(state, parse_action(action))
    except ValueError:
        pytest.fail(f"{action} is legal in {state}: {[str(a) for a, _ in state.actions()]}")
    human = Demonstration(
        one, shape_of(state), shipped[0].spline, "human", "Ada", "2026-11-21T17:00:00+00:00"
    )
    path = tmp_path / "new" / "mine.jsonl"
    add_demonstration(path, human)
    path.write_text(path.read_text().rstrip("\n"))  # as some editors save it
    add_demonstration(path, shipped[0])
    again, other = load_demonstrations(path)
    assert again.task.action == parse_action(action) and again.task.start_state == state
    assert (again.who, again.when) == (human.who, human.when)
    assert (other.who, other.task) == ("", shipped[0].task)


def test_files_of_two_people_merge_and_doubles_are_refused(shipped, tmp_path):
    one, two = tmp_path / "one.jsonl", tmp_path / "two.jsonl"
    save_demonstrations(one, shipped[:2])
    save_demonstrations(two, shipped[2:4])
    merged = merge_demonstrations([one, two])
    assert [item.task for item in merged] == [item.task for item in shipped[:4]]
    add_demonstration(two, shipped[1])
    with pytest.raises(DemonstrationError, match=r"two.jsonl, line 3 is the same .*one.jsonl, l"):
        merge_demonstrations([one, two])
    two.write_text("")
    with pytest.raises(DemonstrationError, match=r"two.jsonl has no demonstrations"):
        merge_demonstrations([one, two])


STARTS = {
    "R1(0,1,1)": 0,
    "R2(0,0,1,1)": 0,
    "C(0,1,1)": 1,
    "C(0,2,1)": 1,
    "C(2,1,-1)": 1,
    "C(2,0,-1)": 1,
    "C(2,0,1)": 2,
    "C(2,4,1)": 2,
}


def test_tasks_are_the_authors():
    assert {str(one.action): one.start_state.num_crossings for one in TASKS} == STARTS
    assert list(STARTS) == [str(one.action) for one in TASKS]


def test_tasks_lead_to_the_overhand():
    overhand = knot("overhand")
    assert "C(2,0,1)" in {str(one.action) for one in TASKS if one.goal_state in overhand}


def test_names_of_tasks_differ():
    assert len({one.name for one in TASKS}) == len(TASKS)


def test_task_names_are_unique_identifiers():
    names = {one.name for one in TASKS}
    assert len(names) == 8
    assert all(name.isidentifier() for name in names)


def test_unknown_task_lists_the_valid_ones():
    assert task("C(2,0,1)") is TASKS[6]
    with pytest.raises(ValueError, match=r"'C\(9,9,1\)'; the eight are R1\(0,1,1\), R2"):
        task("C(9,9,1)")

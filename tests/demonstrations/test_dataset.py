"""The shipped demonstrations, and files that are none."""

import json
from collections import Counter

import numpy as np
import pytest

from knotflow.demonstrations import (
    SHIPPED,
    TASKS,
    DemonstrationError,
    load_demonstrations,
    save_demonstrations,
)
from knotflow.simulation import RopeConfig, check_points, check_splines, resample
from knotflow.topology import TopologicalState


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"action": "C(7,7,1)"}, r"line 1: no demonstrated action is called"),
        ({"spline": [2, 0, 0, 0.1, 0, 0]}, r"line 1: spline\[\] has grasp = 2"),
        ({"spline": [1, 2]}, r"line 1: splines have shape"),
        ({"points": [[0, 0]]}, r"line 1: points must be finite and \(V, 3\)"),
        ({"points": "here"}, r"line 1"),
        ({"source": None}, r"line 1: 'source' is missing"),
    ],
)
def test_a_wrong_line_is_named(tmp_path, change, message):
    row = json.loads(SHIPPED.read_text().splitlines()[0]) | change
    row = {key: value for key, value in row.items() if value is not None}
    path = tmp_path / "wrong.jsonl"
    path.write_text(json.dumps(row) + "\n")
    with pytest.raises(DemonstrationError, match=message):
        load_demonstrations(path)


def test_a_line_that_is_no_json_is_named(tmp_path):
    path = tmp_path / "wrong.jsonl"
    path.write_text(SHIPPED.read_text().splitlines()[0] + "\n{oops\n")
    with pytest.raises(DemonstrationError, match="line 2"):
        load_demonstrations(path)

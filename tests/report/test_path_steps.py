"""What each action of a path leaves for the next, in the report."""

import pytest

from knotflow.report.page import compose
from knotflow.report.paper import TREE_SIZE
from knotflow.report.path_steps import hardest_steps, left_ropes, step_table
from knotflow.report.results import Results, ResultsError

STEPS = ("start", "action", "shape", "splines", "successes")
SHAPES = ("start", "action", "shape", "point", "x", "y", "z")
R1, CROSS = "R1(0,1,1)", "C(0,1,1)"


def steps(write, method, *rows):
    write.table("tree_size", f"{method}_steps.csv", STEPS, rows)


def shapes(write, method, count):
    ropes = [
        ("arc", action, shape, point, round(0.025 * point - 0.5, 3), 0.002 * point, 0.008)
        for action in (R1, CROSS)
        for shape in range(count)
        for point in range(41)
    ]
    write.table("tree_size", f"{method}_shapes.csv", SHAPES, ropes)


def test_a_line_a_method_with_the_ropes_from_which_nothing_succeeds(write):
    steps(
        write, "imitation", ("arc", R1, 0, 8, 8), ("arc", CROSS, 0, 8, 0), ("arc", CROSS, 1, 8, 4)
    )
    steps(write, "icp", ("arc", R1, 0, 8, 0))
    lines = step_table(Results(write.root), "tree_size", TREE_SIZE).splitlines()
    assert lines[0].split("|")[3:5] == [f" `{R1}` ", f" `{CROSS}` "]
    icp, imitation = lines[2:]
    assert "none from 1 of 1 ropes" in icp and icp.rstrip().endswith("– |")
    assert "| 100.0 % (" in imitation
    assert "25.0 % (" in imitation and "none from 1 of 2 ropes" in imitation


def test_the_action_that_succeeds_least_is_named_for_each_start(write):
    steps(
        write,
        "icp",
        ("straight", R1, 0, 8, 2),
        ("straight", CROSS, 0, 8, 4),
        ("arc", R1, 0, 8, 8),
        ("arc", CROSS, 0, 8, 0),
        ("arc", CROSS, 1, 8, 4),
    )
    straight, arc = hardest_steps(Results(write.root), "tree_size", "icp").split("; ")
    assert straight.startswith(f"`{R1}` from the straight rope, 25.0 %")
    assert arc.startswith(f"`{CROSS}` from the arc rope, 25.0 %")
    assert arc.endswith("none from 1 of 2 ropes")


def test_nothing_measured_is_nothing_shown(write):
    results = Results(write.root)
    assert hardest_steps(results, "tree_size", "icp") == ""
    assert step_table(results, "tree_size", TREE_SIZE) == ""
    assert left_ropes(results, "tree_size", TREE_SIZE, "left") is None


def test_the_ropes_that_were_left_are_drawn(write):
    shapes(write, "icp", 2)
    shapes(write, "reinforcement", 3)
    picture = left_ropes(Results(write.root), "tree_size", TREE_SIZE, "left")
    assert picture.alt.startswith("5 ropes")
    assert picture.svg.count(b">ICP<") == 1 == picture.svg.count(b">imitation + RL<")
    again = left_ropes(Results(write.root), "tree_size", TREE_SIZE, "left")
    assert again.png == picture.png


def test_both_stand_in_the_section(write):
    write.searches("tree_size", "method", [("icp", "arc", 0, 17, True, 1.0)])
    steps(write, "icp", ("arc", R1, 0, 8, 8), ("arc", CROSS, 0, 8, 1), ("arc", CROSS, 1, 8, 2))
    shapes(write, "icp", 2)
    found = compose(Results(write.root), "../results")
    (line,) = (one for one in found.markdown.splitlines() if one.startswith("| arc | ICP | 100"))
    assert "18.8" in line
    assert "tree_size_left" in [picture.name for picture in found.pictures]


def test_a_rope_stands_there_once(write):
    steps(write, "icp", ("arc", R1, 0, 8, 8), ("arc", R1, 0, 8, 7))
    with pytest.raises(ResultsError, match="stands in an earlier row"):
        step_table(Results(write.root), "tree_size", TREE_SIZE)

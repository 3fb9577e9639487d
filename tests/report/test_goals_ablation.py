"""What each part brings: a line a method, compared goal by goal."""

import pytest

from knotflow.report.goals_ablation import HINDSIGHT, SECTION
from knotflow.report.page import compose
from knotflow.report.results import Results
from knotflow.report.section import Pictures

GOALS = [("three", f"2o1+{3 + 2 * i}o{4 + 2 * i}+") for i in range(6)]


def write_method(write, name, tied, goals=GOALS, experiment="goals_ablation"):
    rows = [(*goal, one, 2.0) for goal, one in zip(goals, tied, strict=True)]
    write.goals(rows, experiment, f"{name}.csv")


def test_differences_are_paired_by_goal_whatever_the_order(write):
    write_method(write, "complete", [1, 1, 1, 1, 0, 0])
    write_method(write, "without_arranging", [0, 0, 1, 1, 1, 1], GOALS[::-1])
    lines = SECTION.values(Results(write.root), Pictures())["table"].splitlines()[2:]
    assert "4 of 6" in lines[0] and lines[0].endswith("| – |")
    difference = lines[1].split("|")[3]  # each goal was tied by both, or by neither
    assert float(difference.split()[0]) == 0.0


@pytest.mark.parametrize(
    ("name", "section"), [("without_arranging", SECTION), ("without_hindsight", HINDSIGHT)]
)
def test_a_method_whose_counterpart_is_missing_differs_from_nothing(write, name, section):
    write_method(write, name, [1, 0, 1, 0, 1, 0], experiment=section.experiment)
    (line,) = section.values(Results(write.root), Pictures())["table"].splitlines()[2:]
    assert line.endswith("| – |") and "3 of 6" in line


def test_it_is_part_of_the_report_once_it_was_run(write):
    assert SECTION.values(Results(write.root), Pictures()) is None
    write_method(write, "complete", [1, 1, 1, 1, 0, 0])
    text = compose(Results(write.root), "results").markdown
    assert "What each part of planning brings" in text and "type of 4 of 4 tied ropes" in text

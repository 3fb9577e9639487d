"""The results folder: what is read of it, what is not, and what makes it unreadable."""

from __future__ import annotations

import pytest

from knotflow.report.results import Results
from knotflow.report.rows import ResultsError


def test_no_folder_is_no_results(tmp_path):
    assert Results(tmp_path / "nowhere").experiments == {}


@pytest.mark.parametrize("folder", ["stages", "metrics"])
def test_stage_outputs_are_never_read(write, folder):
    path = write.root / folder / "success_rates.csv"
    path.parent.mkdir(parents=True)
    path.write_text("not a table")
    assert Results(write.root).experiments == {}


def test_an_experiment_without_tables_is_not_measured(write):
    write.run("single_stage", {})
    assert not Results(write.root).experiments["single_stage"].measured


def test_a_table_alone_is_enough(write):
    write.table("single_stage", "any.csv", ("x",), [(1,)], budget="smoke")
    found = Results(write.root).experiments["single_stage"]
    assert (found.budget, found.commit[:4], found.dirty, found.stages) == (
        *("smoke", "0123", False),
        [],
    )


def test_run_json_tells_of_stages_and_missing_keys_are_tolerated(write):
    told = {
        "one": {"stage": "make", "signature": "a", "seconds": 2, "caption": "c"},
        "two": {"origin": "shared"},
    }
    write.run("single_stage", told)
    one, two = Results(write.root).experiments["single_stage"].stages
    assert (one.node, one.stage, one.seconds, one.shared) == ("one", "make", 2.0, False)
    assert (two.stage, two.seconds, two.shared, two.caption) == ("two", None, True, "")


def test_the_rope_is_found_in_the_resolved_config(write):
    write.run("single_stage", {})
    (rope,) = Results(write.root).experiments["single_stage"].ropes
    assert rope == {"length": 1.0, "radius": 0.008, "links": 40}


def test_tables_of_another_budget_than_the_run_are_refused(write):
    write.run("single_stage", {}, budget="paper")
    write.table("single_stage", "any.csv", ("x",), [(1,)], budget="smoke")
    with pytest.raises(ResultsError, match=r"any.csv, column 'budget'.*'smoke'.*'paper'"):
        Results(write.root)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.csv", "", "empty; needs a header"),
        ("a.csv", "experiment,budget,commit,x\n", "a header and no rows"),
        ("a.csv", "experiment,budget,x\n1,2,3\n", "column 'commit' is missing"),
        ("a.csv", "experiment,budget,commit,x,x\n1,2,3,4,5\n", "'x' appears more than once"),
        ("a.csv", "experiment,budget,commit\n1,2,3\n1,2\n", r"row 2 \(line 3\): 2 cells"),
        ("a.csv", "experiment,budget,commit\ne,smoke,3\ne,paper,3\n", "'budget', row 2"),
        ("run.json", "{", "not JSON"),
        ("run.json", "[1]", "list where a mapping was expected"),
        ("config.yaml", "a: [", "not YAML"),
    ],
)
def test_a_broken_file_is_named(write, name, content, problem):
    path = write.root / "single_stage" / name
    path.parent.mkdir(parents=True)
    path.write_text(content)
    with pytest.raises(ResultsError, match=f"single_stage/{name}.*{problem}"):
        Results(write.root)

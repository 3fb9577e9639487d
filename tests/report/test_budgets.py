"""Times of the experiments, and what fewer of them show."""

import shutil

from tests.report.conftest import Writer

from knotflow.report.budgets import in_an_afternoon, timing
from knotflow.report.results import Results


def run_times(write):
    return timing(Results(write.root))


def test_nothing_recorded_is_said(write):
    write.run("goals", {})
    assert run_times(write) == "No run has recorded its stages yet."


def test_time_by_experiment_and_shared_stages_once(write):
    write.run("goals", {"goals": {"key": "g", "seconds": 90.0}})
    write.run("knots", {"again": {"key": "g", "seconds": 0.1}, "knots": {"seconds": 30.0}})
    text = run_times(write)
    assert "took 2 min 0 s in 2 stages" in text
    assert "| `goals` | 1 | 1 min 30 s |" in text
    assert "| `knots` | 1 | 30 s |" in text


def test_time_of_a_shared_stage_counts_for_the_first_experiment_of_the_report(write):
    write.run("ablation_actor_critic", {"imitation": {"key": "i", "seconds": 60.0}})
    write.run("single_stage", {"imitation": {"key": "i", "seconds": 60.0}})
    text = run_times(write)
    assert "| `single_stage` | 1 | 1 min 0 s |" in text
    assert "ablation_actor_critic" not in text


def test_time_by_kind(write):
    write.run("tree_size", {"searches": {"seconds": 60.0}})
    write.run("strand_training", {"strand_training": {"seconds": 120.0}}, ships={"a": "b"})
    write.run("knots", {"knots": {"seconds": 30.0}})
    text = run_times(write)
    assert "the paper's 1 min 0 s, trainings of what ships 2 min 0 s and others 30 s" in text


def test_times_and_figures_of_both_budgets_are_side_by_side(write):
    write.run("goals", {"goals": {"key": "g", "seconds": 5400.0}})
    write.run("knots", {"knots": {"seconds": 30.0}})
    write.goals([("three", "1o2-", True, 1.0), ("three", "1o2+", True, 1.0)])
    shorter = Writer(write.root / "afternoon")
    shorter.run("goals", {"goals": {"key": "h", "seconds": 600.0}}, "afternoon")
    shorter.goals([("three", "1o2-", True, 1.0), ("three", "1o2+", False, 1.0)])
    text = run_times(write)
    assert "| experiment | stages | time | in an afternoon |" in text
    assert "| `goals` | 1 | 1 h 30 min | 10 min 0 s |" in text
    assert "| `knots` | 1 | 30 s | – |" in text
    assert "By `budget=afternoon` 1 of 2 took 10 min 0 s in 1 stages: others 10 min 0 s." in text
    rows = in_an_afternoon(Results(write.root)).splitlines()
    states = [row for row in rows if row.startswith("| [Which states]")]
    assert [row.split(" | ")[1:] for row in states] == [
        ["of three crossings", "2 of 2", "1 of 2 |"]
    ]
    assert len(rows) == 3  # nothing else was run in an afternoon


def test_verdicts_of_both_budgets_are_side_by_side(everything, tmp_path):
    shutil.copytree(everything / "tree_size", tmp_path / "tree_size")
    shutil.copytree(everything / "tree_size", tmp_path / "afternoon" / "tree_size")
    rows = in_an_afternoon(Results(tmp_path)).splitlines()
    claims = [row for row in rows if "(#tree-size)" in row]
    assert claims
    for row in claims:
        _, full, less = row.strip("| ").split(" | ")
        assert less.startswith(f"**{full}**<br>")


def test_without_an_afternoons_run_there_is_none(write):
    write.run("goals", {"goals": {"key": "g", "seconds": 90.0}})
    assert in_an_afternoon(Results(write.root)) == "Not run."

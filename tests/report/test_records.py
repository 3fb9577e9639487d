"""A table that is not what its contract says is refused, and the message names the place."""

from __future__ import annotations

import re

import pytest

from knotflow.report.results import Results
from knotflow.report.rows import ResultsError

RATE = ("method", "action", "trials", "successes", "success_rate", "ci_low", "ci_high")
GOOD = ("random", "C(0,1,1)", 10, 3, 0.3, 0.1078, 0.6032)
BRANCHES = ("method", "start", "seed", "branches", "solved", "seconds")


def rates_of(write, rows, columns=RATE):
    write.table("single_stage", "success_rates.csv", columns, rows)
    return Results(write.root).rates("single_stage")


def test_a_good_table_is_read(write):
    rates = rates_of(write, [GOOD])
    rate = rates.get("random", "C(0,1,1)")
    assert (rate.successes, rate.trials) == (3, 10)
    assert rates.get("icp", "C(0,1,1)") is None


@pytest.mark.parametrize(
    ("column", "value", "problem"),
    [
        ("success_rate", 0.5, "disagrees with 3/10"),
        ("ci_low", 0.2, "disagrees with 3/10: the lower 95 % Wilson limit"),
        ("ci_high", 0.3, "disagrees with 3/10: the upper 95 % Wilson limit"),
        ("successes", 11, "11 of only 10 trials"),
        ("trials", 0, "0 is outside"),
        ("trials", 9.5, "not a whole number"),
        ("successes", "many", "'many' is not a number"),
        ("success_rate", "nan", "nan is outside"),
        ("action", "R3(0)", "'R3(0)' is no topological action"),
    ],
)
def test_a_wrong_cell_is_named_with_file_column_and_row(write, column, value, problem):
    bad = list(GOOD)
    bad[RATE.index(column)] = value
    other = ("icp", *GOOD[1:])
    where = rf"single_stage/success_rates\.csv, column '{column}', row 2 \(line 3\): "
    with pytest.raises(ResultsError, match=where + ".*" + re.escape(problem)):
        rates_of(write, [other, bad])


@pytest.mark.parametrize("column", RATE)
def test_a_missing_column_is_named(write, column):
    keep = [i for i, name in enumerate(RATE) if name != column]
    with pytest.raises(ResultsError, match=f"success_rates.csv: column '{column}' is missing"):
        rates_of(write, [[GOOD[i] for i in keep]], [RATE[i] for i in keep])


def test_a_rate_told_twice_is_refused(write):
    with pytest.raises(ResultsError, match="row 2 .* stands in an earlier row already"):
        rates_of(write, [GOOD, GOOD])


def test_start_rates_have_to_sum_to_the_rates(write):
    rates_of(write, [GOOD])
    columns = ("method", "action", "start", "trials", "successes")
    starts = [("random", "C(0,1,1)", "a", 5, 1), ("random", "C(0,1,1)", "b", 5, 2)]
    write.table("single_stage", "per_start.csv", columns, starts)
    assert len(Results(write.root).start_rates("single_stage")) == 2
    write.table("single_stage", "per_start.csv", columns, starts[:1])
    with pytest.raises(ResultsError, match="sum to 1/5, success_rates.csv says 3/10"):
        Results(write.root).start_rates("single_stage")


@pytest.mark.parametrize(("cell", "solved"), [("True", True), ("false", False), ("1", True)])
def test_searches_are_read(write, cell, solved):
    write.table("tree_size", "branches.csv", BRANCHES, [("icp", "arc", 4, 17, cell, 2.5)])
    (search,) = Results(write.root).tree_size
    assert (search.arm, search.start, search.seed, search.branches) == ("icp", "arc", 4, 17)
    assert search.solved is solved


def test_solved_is_a_truth_value(write):
    write.table("tree_size", "branches.csv", BRANCHES, [("icp", "arc", 4, 17, "maybe", 2.5)])
    with pytest.raises(ResultsError, match="column 'solved', row 1 .*neither true nor false"):
        _ = Results(write.root).tree_size


def test_throughput_agrees_with_rollouts_and_seconds(write):
    columns = ("case", "links", "threads", "rollouts", "seconds")
    columns += ("splines_per_second", "peak_memory_mb")
    write.table("benchmark", "throughput.csv", columns, [("a", 40, 2, 100, 2.5, 40.1, 500)])
    assert Results(write.root).throughput[0].splines_per_second == 40.1
    write.table("benchmark", "throughput.csv", columns, [("a", 40, 2, 100, 2.5, 60, 500)])
    with pytest.raises(ResultsError, match="column 'splines_per_second', row 1"):
        _ = Results(write.root).throughput

"""Success rates: read with care, drawn the same each time, nothing hidden that was not run."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import matplotlib
import pytest

from knotflow.report.paper import SINGLE_STAGE, with_extras
from knotflow.report.rates import rate_table, read_rates, success_rates
from knotflow.report.results import Results, ResultsError

RATE = ("method", "action", "trials", "successes", "success_rate", "ci_low", "ci_high")
GOOD = ("random", "C(0,1,1)", 10, 3, 0.3, 0.1078, 0.6032)


def read(write):
    return read_rates(Results(write.root), "single_stage")


def rates_of(write, rows, columns=RATE):
    write.table("single_stage", "success_rates.csv", columns, rows)
    return read(write)


def words(picture):
    root = ElementTree.fromstring(picture.svg)
    return [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]


def test_a_good_table_is_read(write):
    rates = rates_of(write, [GOOD])
    assert rates.counts("random", "C(0,1,1)") == (3, 10)
    assert rates.counts("icp", "C(0,1,1)") is None


@pytest.mark.parametrize(
    ("column", "value", "problem"),
    [
        ("success_rate", 0.5, "disagrees with 3/10"),
        ("ci_low", 0.2, "disagrees with 3/10: not the lower 95 % Wilson limit"),
        ("ci_high", 0.3, "disagrees with 3/10: not the upper 95 % Wilson limit"),
        ("successes", 11, "11 of only 10 trials"),
        ("trials", 0, "'0' is outside"),
        ("trials", 9.5, "not a whole number"),
        ("successes", "many", "'many' is not a number"),
        ("success_rate", "nan", "'nan' is not a number"),
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
    assert read(write).solved("random", "C(0,1,1)") == (2, 2)
    write.table("single_stage", "per_start.csv", columns, starts[:1])
    with pytest.raises(ResultsError, match="sum to 1/5, success_rates.csv says 3/10"):
        read(write)


def drawn(write, counts):
    write.rates("single_stage", counts)
    return success_rates(read(write), SINGLE_STAGE, "rates")


def test_same_bytes_whatever_the_users_style(write, rate_counts):
    one = drawn(write, rate_counts(("random", "icp")))
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red", "svg.hashsalt": "x"}):
        again = drawn(write, rate_counts(("random", "icp")))
    assert (one.png, one.svg) == (again.png, again.svg)
    assert b"<dc:date>" not in one.svg and b"Software" not in one.png


def test_methods_not_run_are_named_and_have_no_bars(write, rate_counts):
    shown = set(words(drawn(write, rate_counts(("random",)))))
    assert {"random", "ICP (not run yet)", "imitation (not run yet)"} <= shown
    assert {"R1(0,1,1)", "C(2,4,1)", "3: Cross, an end goes over", "3.5"} <= shown


def test_a_further_method_of_ours_has_its_own_name_and_others_theirs():
    methods = with_extras(SINGLE_STAGE, ["reinforcement_arranged", "my_own", "icp"])[4:]
    assert [method.label for method in methods] == ["self-play + arranging", "my own"]
    assert len({method.colour for method in (*SINGLE_STAGE, *methods)}) == 6


def test_an_action_that_one_method_lacks_is_marked(write, rate_counts):
    counts = rate_counts(("random", "icp"))
    del counts["icp", "C(2,4,1)"]
    assert "–" in words(drawn(write, counts))


def test_the_last_line_is_the_mean_of_a_method_that_was_measured_on_every_action(
    write, rate_counts
):
    counts = dict.fromkeys(rate_counts(("random", "icp")), (20, 40))
    counts["random", "C(2,4,1)"] = (36, 40)
    del counts["icp", "C(2,4,1)"]
    write.rates("single_stage", counts)
    (last,) = rate_table(read(write), SINGLE_STAGE[:2]).splitlines()[-1:]
    assert last.startswith("| mean | 55.0 % (") and last.endswith(") | – |")


def test_intervals_come_from_the_starts_where_they_are_known(write, rate_counts):
    counts = {key: (20, 40) for key in rate_counts(("random", "icp"))}
    write.rates("single_stage", counts)
    wilson = read(write)
    starts = [
        (*key, start, 8, 8 * (start < 2) + 4 * (start == 2)) for key in counts for start in range(5)
    ]
    write.table("single_stage", "per_start.csv", (*RATE[:2], "start", *RATE[2:4]), starts)
    clustered = read(write)
    assert "Wilson" in wilson.intervals and "starts resampled" in clustered.intervals
    one, other = (rates.interval("icp", "C(0,1,1)") for rates in (wilson, clustered))
    assert one.estimate == other.estimate and other.low < one.low and one.high < other.high
    assert (
        clustered.solved("icp", "C(0,1,1)") == (3, 5) and wilson.solved("icp", "R1(0,1,1)") is None
    )
    # The same starts fare alike under both methods here: their ratio is 1, whichever are drawn.
    ratio = clustered.ratio("icp", "random", "C(0,1,1)")
    assert (ratio.low, ratio.estimate, ratio.high) == (1, 1, 1)

"""Success rates: read with care, drawn the same each time, nothing hidden that was not run."""

from __future__ import annotations

import matplotlib
import pytest

from knotflow.report.rates import ICP, IMITATION, RANDOM, REINFORCEMENT, read_rates, with_extras
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Figures

METHODS = (RANDOM, ICP, IMITATION, REINFORCEMENT)
RATE = ("method", "action", "trials", "successes", "success_rate", "ci_low", "ci_high")
GOOD = ("random", "C(0,1,1)", 10, 3, 0.3, 0.1078, 0.6032)


def read(write):
    return read_rates(Results(write.root), "single_stage")


def rates_of(write, rows, columns=RATE):
    write.table("single_stage", "success_rates.csv", columns, rows)
    return read(write)


def test_counts_are_read(write):
    assert rates_of(write, [GOOD]).counts == {("random", "C(0,1,1)"): (3, 10)}


@pytest.mark.parametrize(
    ("column", "value", "problem"),
    [
        ("success_rate", 0.5, "disagree with 3 of 10"),
        ("ci_low", 0.2, "disagree with 3 of 10"),
        ("ci_high", 0.3, "disagree with 3 of 10"),
        ("success_rate", "nan", "success_rate is 'nan'"),
        ("successes", 11, "11 successes of 10 trials"),
        ("trials", 0, "3 successes of 0 trials"),
        ("successes", "many", "successes is 'many'"),
    ],
)
def test_wrong_cell_is_named_with_file_and_line(write, column, value, problem):
    bad = list(GOOD)
    bad[RATE.index(column)] = value
    with pytest.raises(ResultsError, match=rf"success_rates\.csv, line 3: .*{problem}"):
        rates_of(write, [("icp", *GOOD[1:]), bad])


def test_starts_have_to_sum_to_the_rates(write):
    rates_of(write, [GOOD])
    columns = ("method", "action", "start", "trials", "successes")
    starts = [("random", "C(0,1,1)", "a", 5, 1), ("random", "C(0,1,1)", "b", 5, 2)]
    write.table("single_stage", "per_start.csv", columns, starts)
    assert read(write).solved("random", "C(0,1,1)") == (2, 2)
    write.table("single_stage", "per_start.csv", columns, starts[:1])
    with pytest.raises(ResultsError, match="has 3 of 10, but per_start.csv sums to 1 of 5"):
        read(write)


def drawn(write, counts):
    write.rates("single_stage", counts)
    figures = Figures(Results(write.root))
    text = read(write).figure(figures, METHODS, "rates", "Fig. 6 reproduced")
    return text, figures.made["rates"]


def test_figure_is_the_same_whatever_the_users_style(write, rate_counts):
    text, one = drawn(write, rate_counts(("random", "icp")))
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red"}):
        assert drawn(write, rate_counts(("random", "icp"))) == (text, one)
    assert b"Software" not in one and "400 rollouts a bar" in text


def test_figure_with_an_action_that_a_method_lacks(write, rate_counts):
    counts = rate_counts(("random", "icp"))
    del counts["icp", "C(2,4,1)"]
    assert drawn(write, counts)


def test_extra_methods_have_labels_and_colours():
    methods = with_extras(METHODS, ["reinforcement_arranged", "my_own", "icp"])[4:]
    assert [method.label for method in methods] == ["self-play + arranging", "my own"]
    assert len({method.colour for method in (*METHODS, *methods)}) == 6


def test_mean_needs_every_action(write, rate_counts):
    counts = dict.fromkeys(rate_counts(("random", "icp")), (20, 40))
    counts["random", "C(2,4,1)"] = (36, 40)
    del counts["icp", "C(2,4,1)"]
    write.rates("single_stage", counts)
    (last,) = read(write).table(METHODS[:2]).splitlines()[-1:]
    assert last.startswith("| mean | 55.0 % (") and last.endswith(") | – |")


def test_intervals_resample_starts_where_known(write, rate_counts):
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

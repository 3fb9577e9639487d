"""All actions: how often each succeeds, in bins, with and without arranging."""

import pandas as pd
import pytest

from knotflow.report.actions import SECTION, arranging, binned, by_kind, success_rates
from knotflow.report.page import compose
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Pictures

ROWS = [
    ("trivial", "R1(0,1,1)", "R1", 0, 10, 8),
    ("trivial", "R1(0,1,1)", "R1", 3, 10, 10),
    ("2o1+", "C(0,1,1)", "Cross, end over", 0, 20, 0),
    ("2o1+", "C(0,1,1)", "Cross, end over", 3, 20, 6),
    ("1o4+2o3-", "C(0,1,1)", "Cross, end over", 0, 20, 14),
    ("1o4+2o3-", "C(0,1,1)", "Cross, end over", 3, 20, 15),
]


def values(write):
    return SECTION.values(Results(write.root), Pictures())


def test_rates_stand_beside_each_other_with_the_crossings_of_their_start(write):
    write.actions(ROWS)
    columns = ["start", "action", "class", "arranging", "trials", "successes"]
    rates = success_rates(pd.DataFrame(ROWS, columns=columns)).set_index("start")
    assert arranging(rates) == [0, 3]
    assert rates["crossings"].to_dict() == {"trivial": 0, "2o1+": 1, "1o4+2o3-": 2}
    assert rates.loc["2o1+", [0, 3]].tolist() == [0.0, 0.3]


def test_every_rate_is_in_one_bin_and_limits_belong_to_the_lower():
    assert binned(pd.Series([0.0, 0.0, 0.1, 0.3, 0.31, 0.7, 0.71, 1.0])) == [0.25] * 4
    assert sum(binned(pd.Series([0.01 * i for i in range(101)]))) == pytest.approx(1)


def test_totals_say_what_arranging_brings(write):
    write.actions(ROWS)
    found = values(write)
    assert [
        (total["arranging"], total["often"], total["never"], total["mean"])
        for total in found["totals"]
    ] == [(0, 1, 1, "50.0 %"), (3, 2, 0, "68.3 %")]
    # Of the 396 that lead to at most three crossings.
    assert (found["actions"], found["untried"]) == (3, 393)
    text = compose(Results(write.root), "results").markdown
    assert (
        "with one spline\n1 succeed in more than 70\u00a0% of their trials and 1 never did" in text
    )


def test_actions_that_touch_an_end_stand_apart_from_those_that_do_not(write):
    inner = [("2o1+", "R1(1,1,1)", "R1", 0, 10, 0), ("2o1+", "R1(1,1,1)", "R1", 3, 10, 0)]
    outer = [("2o1+", "R1(2,1,1)", "R1", 0, 10, 4), ("2o1+", "R1(2,1,1)", "R1", 3, 10, 5)]
    write.actions([*ROWS, *inner, *outer])
    lines = values(write)["segments"].splitlines()[2:]
    assert lines == [
        "| Cross, end over | 1 | an end | 1 | 0 % | 30 % | 0 |",
        "| Cross, end over | 2 | an end | 1 | 70 % | 75 % | 0 |",
        "| R1 | 0 | an end | 1 | 80 % | 100 % | 0 |",
        "| R1 | 1 | an end | 1 | 40 % | 50 % | 0 |",
        "| R1 | 1 | none | 1 | 0 % | 0 % | 1 |",
    ]


def test_a_run_without_arranging_has_single_bars(write):
    write.actions([row for row in ROWS if not row[3]])
    segments = values(write)["segments"]
    assert "one spline" in segments and "3 arranging" not in segments


def test_the_picture_has_a_panel_a_class_and_counts_its_actions(write):
    columns = ["start", "action", "class", "arranging", "trials", "successes"]
    svg = by_kind(success_rates(pd.DataFrame(ROWS, columns=columns)), "a").svg
    assert svg.index(b">R1<") < svg.index(b">Cross, end over<")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (("trivial", "R1(0,1,1)", "R1", 0, 10, 8), "stands in an earlier row already"),
        (("trivial", "R1(0,1,-1)", "R1", 0, 10, 11), "11 of only 10 trials"),
        (("trivial", "R1(0,1,-1)", "R1", 0, 0, 0), "'0' is outside"),
    ],
)
def test_spoilt_tables_are_refused(write, row, message):
    write.actions([*ROWS, row])
    with pytest.raises(ResultsError, match=message):
        values(write)

"""All actions: how often each succeeds, with and without arranging."""

import pandas as pd
import pytest

from knotflow.report.actions import arranging, success_rates
from knotflow.report.results import ResultsError

COLUMNS = ["start", "action", "class", "arranging", "trials", "successes"]
ROWS = [
    ("trivial", "R1(0,1,1)", "R1", 0, 10, 8),
    ("trivial", "R1(0,1,1)", "R1", 3, 10, 10),
    ("2o1+", "C(0,1,1)", "Cross, end over", 0, 20, 0),
    ("2o1+", "C(0,1,1)", "Cross, end over", 3, 20, 6),
    ("1o4+2o3-", "C(0,1,1)", "Cross, end over", 0, 20, 14),
    ("1o4+2o3-", "C(0,1,1)", "Cross, end over", 3, 20, 15),
]


def test_rates_have_the_crossings_of_their_start():
    rates = success_rates(pd.DataFrame(ROWS, columns=COLUMNS)).set_index("start")
    assert arranging(rates) == [0, 3]
    assert rates["crossings"].to_dict() == {"trivial": 0, "2o1+": 1, "1o4+2o3-": 2}
    assert rates.loc["2o1+", [0, 3]].tolist() == [0.0, 0.3]


def test_totals_with_and_without_arranging(write):
    write.actions(ROWS)
    text = write.body("actions")
    assert "Of 3 actions up to Mirror and Reverse, with one spline 1 succeed" in text
    assert "10 to 20 trials an action" in text
    assert "1 never did (mean 50.0 %)" in text and "0 never did (mean 68.3 %)" in text


def test_actions_that_touch_an_end_stand_apart(write):
    inner = [("2o1+", "R1(1,1,1)", "R1", most, 10, 0) for most in (0, 3)]
    write.actions([*ROWS, *inner, ("2o1+", "R1(2,1,1)", "R1", 0, 10, 4),
                   ("2o1+", "R1(2,1,1)", "R1", 3, 10, 5)])  # fmt: skip
    assert write.body("actions").splitlines()[-5:] == [
        "| Cross, end over | 1 | an end | 1 | 0 % | 30 % | 0 |",
        "| Cross, end over | 2 | an end | 1 | 70 % | 75 % | 0 |",
        "| R1 | 0 | an end | 1 | 80 % | 100 % | 0 |",
        "| R1 | 1 | an end | 1 | 40 % | 50 % | 0 |",
        "| R1 | 1 | none | 1 | 0 % | 0 % | 1 |",
    ]


def test_run_without_arranging_has_one_column(write):
    write.actions([row for row in ROWS if not row[3]])
    text = write.body("actions")
    assert "mean with one spline" in text and "arranging splines" not in text


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (("trivial", "R1(0,1,1)", "R1", 0, 10, 8), "is there twice"),
        (("trivial", "R1(0,1,-1)", "R1", 0, 10, 11), "11 successes of 10 trials"),
        (("trivial", "R1(0,1,-1)", "R1", 0, 0, 0), "0 successes of 0 trials"),
    ],
)
def test_invalid_tables_are_refused(write, row, message):
    write.actions([*ROWS, row])
    with pytest.raises(ResultsError, match=message):
        write.body("actions")

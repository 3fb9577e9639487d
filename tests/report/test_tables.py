"""Numbers as they are written."""

from __future__ import annotations

import math

import pytest

from knotflow.intervals import Interval
from knotflow.report import tables


@pytest.mark.parametrize(
    ("value", "written"),
    [(0.316, "0.32"), (9.999, "10.0"), (30.04, "30.0"), (112.4, "112"), (-1234.0, "−1,234")],
)
def test_number(value, written):
    assert tables.number(value) == written


@pytest.mark.parametrize(
    ("seconds", "written"),
    [
        *((None, "–"), (0.04, "0.0 s"), (9.96, "10 s"), (59.4, "59 s"), (59.6, "1 min 0 s")),
        *((200.4, "3 min 20 s"), (3599.0, "1 h 0 min"), (7500.0, "2 h 5 min")),
    ],
)
def test_duration(seconds, written):
    assert tables.duration(seconds) == written


@pytest.mark.parametrize(
    ("ratio", "written"),
    [
        (Interval(12.0, 8.1, 19.0), "12.0× (8.10 to 19.0)"),
        (Interval(math.inf, 54.4, math.inf), "at least 54.4×"),
        (Interval(math.nan, 0.0, math.inf), "both 0"),
    ],
)
def test_times(ratio, written):
    assert tables.times(ratio) == written


def test_an_interval_without_limits_is_its_estimate():
    assert tables.estimate(Interval(3.0, None, None)) == "3.0"
    assert tables.percent(Interval(0.035, 0.021, 0.058)) == "3.5 % (2.1 to 5.8)"


def test_listed():
    assert [tables.listed(names) for names in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        *("", "a", "a and b", "a, b and c"),
    ]


def test_a_bar_in_a_cell_does_not_end_it():
    table = tables.markdown_table(["x"], [["a|b"]], "r")
    assert table == "| x |\n| ---: |\n| a\\|b |"

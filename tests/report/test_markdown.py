"""Numbers as they are written, and tables of them."""

import math

import pytest

from knotflow.report import markdown as md
from knotflow.statistics import Interval


@pytest.mark.parametrize(
    ("value", "written"),
    [(0.316, "0.32"), (9.999, "10.0"), (30.04, "30.0"), (112.4, "112"), (-1234.0, "−1,234")],
)
def test_number(value, written):
    assert md.number(value) == written


@pytest.mark.parametrize(
    ("seconds", "written"),
    [
        *((None, "–"), (0.04, "0.0 s"), (9.96, "10 s"), (59.4, "59 s"), (59.6, "1 min 0 s")),
        *((200.4, "3 min 20 s"), (3599.0, "1 h 0 min"), (7500.0, "2 h 5 min")),
    ],
)
def test_duration(seconds, written):
    assert md.duration(seconds) == written


@pytest.mark.parametrize(
    ("ratio", "written"),
    [
        (Interval(12.0, 8.1, 19.0), "12.0× (8.10 to 19.0)"),
        (Interval(75.0, 10.2, math.inf), "75.0× (at least 10.2)"),
        (Interval(math.inf, 54.4, math.inf), "at least 54.4×"),
        (Interval(math.nan, 0.0, math.inf), "both 0"),
    ],
)
def test_times(ratio, written):
    assert md.times(ratio) == written


def test_rates_and_estimates():
    assert md.estimate(Interval(3.0)) == "3.0"
    assert md.percent(Interval(0.035, 0.021, 0.058)) == "3.5 % (2.1 to 5.8)"
    assert md.share([True, True, True, False]) == "75.0 % (30.1 to 95.4)<br>3 of 4"
    assert md.share([]) == md.NOTHING


def test_listed():
    found = [md.listed(names) for names in ([], ["a"], ["a", "b"], ["a", "b", "c"])]
    assert found == ["", "a", "a and b", "a, b and c"]


def test_table_aligns_numbers_and_escapes_bars():
    table = md.table([{"name": "a|b", "n": "3 of 4"}, {"name": "c", "n": md.NOTHING}], "Counts:")
    lines = ["| name | n |", "| --- | ---: |", "| a\\|b | 3 of 4 |", "| c | – |"]
    assert table == "\n".join(["Counts:", "", *lines])
    assert md.table([], "Counts:") == ""


def test_slug():
    assert md.slug("The paper's claims: Fig. 6") == "the-papers-claims-fig-6"

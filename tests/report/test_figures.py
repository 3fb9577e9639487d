"""The figures: the same bytes each time, nothing hidden when something was not run."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import matplotlib
import pytest

from knotflow.report import figures
from knotflow.report.paper import SINGLE_STAGE, TREE_SIZE
from knotflow.report.records import Rate, Rates, Search, Searches


def rates_of(counts):
    return Rates([Rate(*key, trials, successes) for key, (successes, trials) in counts.items()])


def text_of(picture):
    root = ElementTree.fromstring(picture.svg)
    return [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]


def test_same_bytes_whatever_the_users_style(rate_counts):
    rates = rates_of(rate_counts(("random", "icp")))
    one = figures.success_rates(rates, SINGLE_STAGE, "rates")
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red", "svg.hashsalt": "x"}):
        again = figures.success_rates(rates, SINGLE_STAGE, "rates")
    assert (one.png, one.svg) == (again.png, again.svg)
    assert b"<dc:date>" not in one.svg and b"Software" not in one.png


def test_methods_not_run_are_named_and_have_no_bars(rate_counts):
    words = text_of(
        figures.success_rates(rates_of(rate_counts(("random",))), SINGLE_STAGE, "rates")
    )
    assert {"random", "ICP (not run yet)", "imitation (not run yet)"} <= set(words)
    assert {"R1(0,1,1)", "C(2,4,1)", "3: Cross, an end goes over", "3.5"} <= set(words)


def test_an_action_that_one_method_lacks_is_marked(rate_counts):
    counts = rate_counts(("random", "icp"))
    del counts["icp", "C(2,4,1)"]
    assert "–" in text_of(figures.success_rates(rates_of(counts), SINGLE_STAGE, "rates"))


def test_an_inlined_figure_has_ids_of_its_own(rate_counts):
    rates = rates_of(rate_counts(("random",)))
    inline = figures.success_rates(rates, SINGLE_STAGE, "mine").inline()
    ids = re.findall(r' id="([^"]+)"', inline)
    assert ids and all(name.startswith("mine-") for name in ids)
    targets = re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', inline)
    assert targets and set(targets) <= set(ids)


@pytest.mark.parametrize("solved", [True, False])
def test_branches_with_a_method_not_run_and_one_single_search(solved):
    searches = Searches([Search("icp", "arc", 0, 40, solved, 1.0)])
    picture = figures.branches(searches, TREE_SIZE, ["straight", "arc"], "b", {})
    assert text_of(picture).count("not run yet") == 5

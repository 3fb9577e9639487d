"""What changes with the link that a rope's chain is rooted in (not in the paper)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from knotflow.report.paper import Method
from knotflow.report.rates import Rates, check_counts, rate_table, ratio_table
from knotflow.report.results import AMOUNT, AT_LEAST_ONE, COUNT, FLAG, TEXT, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import Interval, bootstrap, mean_difference, wilson
from knotflow.report.tables import estimate, listed, markdown_table, percent

EXPERIMENT = "roots"
#: What is changed of the chain rooted in its middle, and what its columns begin with.
ROOT, STEP = "root", "timestep"
MIDDLE = Method("middle", "rooted in the middle", "#0072b2")
HEAD = Method("head", "rooted at the head", "#e69f00")
ENDS = {"splines": TEXT, "spline": COUNT}
ENDS |= {f"{one}_distance_mm": AMOUNT for one in (ROOT, STEP)}
ENDS |= {f"{one}_same_state": FLAG for one in (ROOT, STEP)}
SUCCESSES = {"action": TEXT, "demonstration": COUNT, "root": TEXT}
KEY = tuple(SUCCESSES)
SUCCESSES |= {"trials": AT_LEAST_ONE, "successes": COUNT}


def values(results: Results, _: Pictures) -> dict[str, Any] | None:
    """How far ends are apart, beside what half the time step does, and success by root."""
    ends = results.table(EXPERIMENT, "ends.csv", ENDS, key=("splines", "spline"))
    rates = successes(results)
    if ends is None or rates is None:
        return None
    kinds = {str(kind): own for kind, own in ends.groupby("splines")}
    ratios = {action: rates.ratio(MIDDLE.name, HEAD.name, action) for action in rates.actions}
    differ = [action for action, one in ratios.items() if one.lies_above(1) or not one.reaches(1)]
    return {
        "ends": _table(kinds),
        "farther": listed([kind for kind, own in kinds.items() if farther(own).lies_above(0)]),
        "rates": rate_table(rates, (MIDDLE, HEAD)),
        "ratios": ratio_table(rates, [(MIDDLE, HEAD)]),
        "differ": listed([f"`{action}`" for action in differ]),
        "actions": len(ratios),
    }


def successes(results: Results) -> Rates | None:
    """Success rates by root, start by start where an action has several demonstrations."""
    table = results.table(EXPERIMENT, "successes.csv", SUCCESSES, key=KEY)
    if table is None:
        return None
    check_counts(table)
    copies = table.rename(columns={"root": "method", "demonstration": "start"})
    groups = copies.groupby(["method", "action"], sort=False)
    sums = groups[["trials", "successes"]].sum().reset_index()
    return Rates(sums, copies[groups["start"].transform("size") > 1])


def farther(ends: pd.DataFrame) -> Interval:
    """By how much more the root moves a spline's end than the time step does, mm, median."""
    return bootstrap(ends[f"{ROOT}_distance_mm"] - ends[f"{STEP}_distance_mm"], np.median)


def _table(kinds: dict[str, pd.DataFrame]) -> str:
    lines = []
    for kind, own in kinds.items():
        distances = (bootstrap(own[f"{one}_distance_mm"], np.median) for one in (ROOT, STEP))
        same = [own[f"{one}_same_state"] for one in (ROOT, STEP)]
        points = mean_difference(100.0 * same[0], 100.0 * same[1], paired=True)
        lines.append(
            [
                *(kind, f"{len(own):,}", *map(estimate, distances), estimate(farther(own))),
                *(percent(wilson(int(one.sum()), len(own))) for one in same),
                estimate(points),
            ]
        )
    header = ["splines", "n"]
    header += ["other root, mm", "half the time step, mm", "difference, mm"]
    header += ["same end state: other root", "half the time step", "difference, points"]
    return markdown_table(header, lines, "l" + "r" * 7)


SECTION = Section(
    EXPERIMENT,
    "The root of the rope's chain",
    "Not in the paper",
    "Where ropes end, and how often splines succeed, with the chain of links rooted in its middle "
    "link, which simulates faster, and at its head.",
    values,
)

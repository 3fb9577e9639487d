"""What the tables of plans hold, checked as they are read."""

from __future__ import annotations

from dataclasses import dataclass

from knotflow.report.records import Search, Searches, read_searches
from knotflow.report.results import Results
from knotflow.report.rows import Row, require
from knotflow.report.statistics import Interval, wilson

KNOTS = "knots"
OVERHAND = "overhand"
PENTAGRAM = "pentagram"

#: The starts of the experiment pentagram: what its table calls them, and what they are.
PULLED = "pulled_overhand"
PENTAGRAM_STARTS = {
    PULLED: "overhand, its head pulled out",
    "straight": "straight rope, no hand in it",
}


@dataclass(frozen=True)
class Told:
    """What a search found: the path of actions, and the knot type an independent library tells."""

    path: str
    knot_type: str
    confirmed: str
    reason: str


@dataclass(frozen=True)
class KnotSuccess:
    """How often a knot was tied from one kind of start."""

    goal: str
    start: str
    searches: int
    tied: int
    branches_median: float | None
    seconds_median: float | None
    confirmed: int

    @property
    def interval(self) -> Interval:
        """The share tied with its 95 % Wilson interval."""
        return wilson(self.tied, self.searches)


def searches(results: Results, experiment: str) -> tuple[Searches, list[Told]] | None:
    """branches.csv of an experiment that plans, None where it was not run."""
    rows = results.table(experiment, "branches.csv")
    if not rows:
        return None
    require(rows, ("path", "knot_type", "confirmed", "reason"))
    told = [
        Told(*(row.text(column) for column in ("path", "knot_type", "confirmed", "reason")))
        for row in rows
    ]
    return read_searches(rows, "goal", with_start=True), told


def pentagram_trees(results: Results, start: str) -> list[Search]:
    """The searches for the pentagram from one start, none where they were not run."""
    found = searches(results, PENTAGRAM)
    return [search for search in found[0] if search.start == start] if found else []


def read_knots(rows: list[Row]) -> list[KnotSuccess]:
    """knots.csv."""
    counts = ("searches", "tied", "confirmed")
    require(rows, ("goal", "start", *counts, "branches_median", "seconds_median"))
    found = []
    for row in rows:
        total, tied, confirmed = (row.count(column) for column in counts)
        if tied > total:
            raise row.error("tied", f"{tied} of only {total} searches")
        if confirmed > tied:
            raise row.error("confirmed", f"{confirmed} of only {tied} tied ropes")
        found.append(
            KnotSuccess(
                goal=row.text("goal"),
                start=row.text("start"),
                searches=row.count("searches", at_least=1),
                tied=tied,
                branches_median=row.number_in("branches_median", 0) if tied else None,
                seconds_median=row.number_in("seconds_median", 0) if tied else None,
                confirmed=confirmed,
            )
        )
    return found


def confirmation(told: list[Told]) -> str:
    """How many of the tied ropes an independent library found to be the knot they should be."""
    tied = [one for one in told if one.confirmed]
    if not tied:
        return "No rope was tied."
    yes = sum(one.confirmed == "yes" for one in tied)
    unchecked = sum(one.confirmed not in ("yes", "no") for one in tied)
    told_so = f"{yes} of {len(tied)} tied ropes"
    missing = f"; {unchecked} were not checked" if unchecked else ""
    return f"An independent library (topoly) confirms the knot type of {told_so}{missing}."

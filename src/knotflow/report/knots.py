"""Named knots from ropes as they lie: which are tied, and with what effort."""

from __future__ import annotations

from typing import Any

from knotflow.intervals import wilson
from knotflow.report.results import AT_LEAST_ONE, COUNT, TEXT, Column, Results, refuse
from knotflow.report.searches import confirmation, read_searches
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import NOTHING, duration, markdown_table, percent

EXPERIMENT = "knots"
#: Of the searches that tied the knot: empty where none did.
MEDIAN = Column("number", 0, optional=True)
COLUMNS = {"goal": TEXT, "start": TEXT, "searches": AT_LEAST_ONE, "tied": COUNT}
COLUMNS |= {"confirmed": COUNT, "branches_median": MEDIAN, "seconds_median": MEDIAN}


def values(results: Results, _: Pictures) -> dict[str, Any] | None:
    """The table of successes."""
    knots = results.table(EXPERIMENT, "knots.csv", COLUMNS)
    searches = read_searches(results, EXPERIMENT)
    if knots is None or searches is None:
        return None
    refuse(knots, "tied", knots["tied"] > knots["searches"], "{tied} of only {searches} searches")
    impossible = knots["confirmed"] > knots["tied"]
    refuse(knots, "confirmed", impossible, "{confirmed} of only {tied} tied ropes")
    lines = [
        [
            f"`{knot.goal}`",
            knot.start,
            f"{percent(wilson(knot.tied, knot.searches))}<br>{knot.tied} of {knot.searches}",
            f"{knot.branches_median:g}" if knot.tied else NOTHING,
            duration(knot.seconds_median if knot.tied else None),
            f"{knot.confirmed} of {knot.tied}",
        ]
        for knot in knots.itertuples()
    ]
    header = ["knot", "start", "tied", "branches, median", "time, median", "type confirmed"]
    return {
        "table": markdown_table(header, lines, "llrrrr"),
        "confirmation": confirmation(results, EXPERIMENT, searches),
    }


SECTION = Section(
    EXPERIMENT,
    "Knots from random ropes",
    "Not in the paper",
    "How often a knot is tied within the limit of time: from randomly lying ropes the overhand in "
    "its four states (handedness, and which end goes over first) and larger knots, and the "
    "overhand from tangled ropes.",
    values,
)

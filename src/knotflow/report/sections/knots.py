"""Every state of the overhand, and the figure eight, from randomly lying ropes."""

from __future__ import annotations

from typing import Any

from knotflow.report import tables
from knotflow.report.planning.records import KNOTS, confirmation, read_knots, searches
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The table of successes."""
    rows, found = results.table(KNOTS, "knots.csv"), searches(results, KNOTS)
    if rows is None or found is None:
        return None
    header = ["knot", "start", "tied", "branches, median", "time, median", "type confirmed"]
    lines = [
        [
            f"`{knot.goal}`",
            knot.start,
            f"{tables.percent(knot.interval)}<br>{knot.tied} of {knot.searches}",
            tables.NOTHING if knot.branches_median is None else f"{knot.branches_median:g}",
            tables.duration(knot.seconds_median),
            f"{knot.confirmed} of {knot.tied}",
        ]
        for knot in read_knots(rows)
    ]
    return {
        "table": tables.markdown_table(header, lines, "llrrrr"),
        "confirmation": confirmation(found[1]),
    }


SECTION = Section(
    KNOTS,
    "Knots from random ropes",
    "Not in the paper",
    "How often a knot is tied within the limit of time: the overhand in its four states "
    "(handedness, and which end goes over first), and the figure eight.",
    values,
)

"""A knot more complex than any in training (Sec. VII-E, Fig. 9)."""

from __future__ import annotations

from typing import Any

from knotflow.report import tables
from knotflow.report.planning.judge import PAPER_BRANCHES
from knotflow.report.planning.pictures import stored
from knotflow.report.planning.records import (
    PENTAGRAM,
    PENTAGRAM_STARTS,
    confirmation,
    pentagram_trees,
    searches,
)
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """A line for each start, and the plan of fewest branches from each."""
    found = searches(results, PENTAGRAM)
    if found is None:
        return None
    lines = [
        [name, *tables.search_line(own)]
        for start, name in PENTAGRAM_STARTS.items()
        if (own := pentagram_trees(results, start))
    ]
    plans = {
        folder: stored(
            results,
            pictures.add,
            PENTAGRAM,
            f"{folder}/plan",
            f"pentagram_{folder}",
            f"Plan, {folder}",
        )
        for folder in ("pulled", "untangled")
    }
    return {
        "table": tables.markdown_table(
            ["start", *tables.SEARCH_COLUMNS], lines, "l" + "r" * len(tables.SEARCH_COLUMNS)
        ),
        "confirmation": confirmation(found[1]),
        "paper": PAPER_BRANCHES,
        **plans,
    }


SECTION = Section(
    PENTAGRAM,
    "The pentagram",
    "Sec. VII-E, Fig. 9",
    "A knot more complex than any in training, from an overhand whose head was pulled out, and "
    "from a straight rope.",
    values,
)

"""What the parts of planning and self-play bring: random goals searched for without one of them."""

from __future__ import annotations

from typing import Any

import pandas as pd

from knotflow.report.goals import COLUMNS, share_tied, tied_over_time
from knotflow.report.results import Results
from knotflow.report.searches import confirmation
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import mean_difference
from knotflow.report.tables import NOTHING, estimate, markdown_table, percent

EXPERIMENT = "goals_ablation"
METHODS = {
    "complete": "complete",
    "without_arranging": "without arranging",
    "without_onward": "without value beyond the step",
    "paper_search": "with the paper's search",
    "with_hindsight": "short self-play",
    "without_hindsight": "the same without hindsight",
}
AGAINST = {"without_hindsight": "with_hindsight"} | dict.fromkeys(
    ("without_arranging", "without_onward", "paper_search"), "complete"
)
"""What each differs from by one part."""


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """A line a method, with the difference from what it lacks one part of."""
    found = {
        name: results.table(EXPERIMENT, f"{name}.csv", COLUMNS, key=("set", "goal"))
        for name in METHODS
    }
    tables = {name: table for name, table in found.items() if table is not None}
    if not tables:
        return None
    sets = list(dict.fromkeys(name for table in tables.values() for name in table["set"]))
    header = ["method", *(f"tied, {name} crossings" for name in sets), "difference, points"]
    lines = [
        [
            METHODS[name],
            *(_share(table[table["set"] == one]) for one in sets),
            _difference(table, tables.get(AGAINST.get(name, ""))),
        ]
        for name, table in tables.items()
    ]
    shown = {METHODS[name]: table for name, table in tables.items()}
    return {
        "figure": pictures.add(tied_over_time(shown, EXPERIMENT)),
        "table": markdown_table(header, lines, "l" + "r" * (len(sets) + 1)),
        "confirmation": confirmation(results, EXPERIMENT, pd.concat(tables.values())),
    }


def _share(searches: pd.DataFrame) -> str:
    if searches.empty:
        return NOTHING
    return f"{percent(share_tied(searches))}<br>{searches['solved'].sum()} of {len(searches)}"


def _difference(table: pd.DataFrame, complete: pd.DataFrame | None) -> str:
    """Of the shares of goals tied, paired by goal, in points."""
    if complete is None:
        return NOTHING
    tied, before = (
        100.0 * one.set_index(["set", "goal"])["solved"].sort_index() for one in (table, complete)
    )
    return estimate(mean_difference(tied, before, paired=True))


SECTION = Section(
    EXPERIMENT,
    "What each part brings",
    "Not in the paper",
    "The first of the goals drawn at random, searched for without one part of planning or of "
    "self-play at a time.",
    values,
)

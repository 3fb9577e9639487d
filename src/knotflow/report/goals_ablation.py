"""What the parts of planning and self-play bring: random goals searched for without one of them."""

from __future__ import annotations

from functools import partial
from typing import Any

import pandas as pd

from knotflow.report.goals import COLUMNS, share_tied, tied_over_time
from knotflow.report.results import Results
from knotflow.report.searches import confirmation
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import mean_difference
from knotflow.report.tables import NOTHING, estimate, markdown_table, percent

PLANNING = {
    "complete": "complete",
    "without_arranging": "without arranging",
    "without_onward": "without value beyond the step",
    "paper_search": "with the paper's search",
}
SELF_PLAY = {
    "with_hindsight": "short self-play",
    "without_hindsight": "the same without hindsight",
}
"""Methods of either experiment, by their tables; all others lack a part that the first has."""


def values(
    experiment: str, methods: dict[str, str], results: Results, pictures: Pictures
) -> dict[str, Any] | None:
    """A line a method, with the difference from what it lacks one part of."""
    found = {
        name: results.table(experiment, f"{name}.csv", COLUMNS, key=("set", "goal"))
        for name in methods
    }
    tables = {name: table for name, table in found.items() if table is not None}
    if not tables:
        return None
    sets = list(dict.fromkeys(name for table in tables.values() for name in table["set"]))
    complete = next(iter(methods))
    header = ["method", *(f"tied, {name} crossings" for name in sets), "difference, points"]
    lines = [
        [
            methods[name],
            *(_share(table[table["set"] == one]) for one in sets),
            _difference(table, tables.get(complete) if name != complete else None),
        ]
        for name, table in tables.items()
    ]
    shown = {methods[name]: table for name, table in tables.items()}
    return {
        "figure": pictures.add(tied_over_time(shown, experiment)),
        "table": markdown_table(header, lines, "l" + "r" * (len(sets) + 1)),
        "confirmation": confirmation(results, experiment, pd.concat(tables.values())),
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
    "goals_ablation",
    "What each part of planning brings",
    "Not in the paper",
    "The first of the goals drawn at random, searched for without one part of planning at a time.",
    partial(values, "goals_ablation", PLANNING),
)
HINDSIGHT = Section(
    "self_play_ablation",
    "What hindsight brings",
    "Not in the paper",
    "The same goals, searched for with primitives of a self-play with and without hindsight.",
    partial(values, "self_play_ablation", SELF_PLAY),
)

"""Goal states drawn at random, from random ropes, and the planner ablation on them."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.results import Results
from knotflow.report.searches import OUTCOME, STATE_NOTATION, checks, tied_columns, tied_over_time
from knotflow.report.section import Figures, Section
from knotflow.statistics import mean_difference

COLUMNS = {"set": str, "goal": str, "rope_seed": int} | OUTCOME
KEY = ("set", "goal")
COMPLETE = "complete"
VARIANTS = {
    COMPLETE: "complete",
    "without_arranging": "without arranging",
    "without_onward": "without next-state value",
    "without_next_value": "without next-state value",
    "paper_search": "the paper's search",
}
"""Methods of the ablation, by their tables; all others lack a part that the first has."""


def goals(results: Results, figures: Figures) -> str | None:
    """A line for each number of crossings, the share over time, and every goal not tied."""
    table = results.table("goals", "goals.csv", COLUMNS, KEY)
    if table is None:
        return None
    sets = {str(name): own for name, own in table.groupby("set", sort=False)}
    missed = [
        {
            "crossings": one.set,
            "goal": f"`{one.goal}`",
            "rope": str(one.rope_seed),
            "branches": f"{one.branches:,}",
            "why the search ended": one.reason,
        }
        for one in table[~table["solved"]].itertuples()
    ]
    groups = {f"{name} crossings": own for name, own in sets.items()}
    return md.join(
        tied_over_time(figures, "goals", groups, "number of crossings"),
        md.table([{"crossings": name} | tied_columns(own) for name, own in sets.items()]),
        f"Medians are over the searches that tied their goal. {checks(results, 'goals')}",
        md.table(missed, f"Goals that were not tied, {len(missed)} in all. {STATE_NOTATION}"),
    )


def ablation(results: Results, figures: Figures) -> str | None:
    """A line a method, with the difference from the complete planner, paired by goal."""
    experiment = "goals_ablation"
    found = {name: results.table(experiment, f"{name}.csv", COLUMNS, KEY) for name in VARIANTS}
    tables = {name: table for name, table in found.items() if table is not None}
    if not tables:
        return None
    sets = list(dict.fromkeys(name for table in tables.values() for name in table["set"]))
    rows = [
        {"planner": VARIANTS[name]}
        | {f"tied, {one} crossings": md.share(table["solved"][table["set"] == one]) for one in sets}
        | {"difference, points": _difference(tables, name)}
        for name, table in tables.items()
    ]
    groups = {VARIANTS[name]: table for name, table in tables.items()}
    return md.join(
        "All variants search with the shipped primitives: the complete planner, one without "
        "splines that make room before an action, one that judges a spline by its own success and "
        "not by the state it leaves, and the paper's search, which grows the tree at random and "
        "has none of these nor scripted guesses.",
        tied_over_time(figures, experiment, groups, "planner"),
        md.table(rows),
        "Differences are from the complete planner, paired by goal, with 95 % intervals over "
        "goals.",
    )


def _difference(tables: Mapping[str, pd.DataFrame], name: str) -> str:
    """Of the share of goals tied from that of the complete planner, in points."""
    if name == COMPLETE or COMPLETE not in tables:
        return md.NOTHING
    tied, base = (
        100.0 * tables[one].set_index([*KEY])["solved"].sort_index() for one in (name, COMPLETE)
    )
    return md.estimate(mean_difference(tied, base, paired=True))


GOALS = Section(
    "goals",
    "Random goals",
    "beyond the paper",
    "How many of all states a rope can be brought into: goals drawn at random among all states "
    "with three and with four crossings, each from a random rope of its own. No primitive was "
    "trained on them as a set.",
    goals,
)
ABLATION = Section(
    "goals_ablation",
    "Planner ablation",
    "beyond the paper",
    "The first of the random goals, searched for without one part of the planner at a time.",
    ablation,
)

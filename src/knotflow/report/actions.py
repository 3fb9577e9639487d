"""Which of all actions the primitives can do, with and without arranging."""

from __future__ import annotations

from typing import Any

import pandas as pd

from knotflow.report.actions_figure import OFTEN, arranging, by_kind
from knotflow.report.results import AT_LEAST_ONE, COUNT, TEXT, Results, refuse
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import markdown_table
from knotflow.topology import TopologicalState, all_states
from knotflow.topology.symmetry import distinct_actions, representative

EXPERIMENT = "actions"
KEY = ("start", "action", "arranging")
COLUMNS = {"start": TEXT, "action": TEXT, "class": TEXT, "arranging": COUNT}
COLUMNS |= {"trials": AT_LEAST_ONE, "successes": COUNT}
MOST_CROSSINGS = 3
"""Of the states that the actions lead to."""
WORST_SHOWN = 10


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The picture by kind and crossings, totals in words, and the actions done least often."""
    table = results.table(EXPERIMENT, "actions.csv", COLUMNS, key=KEY)
    if table is None:
        return None
    refuse(
        table,
        "successes",
        table["successes"] > table["trials"],
        "{successes} of only {trials} trials",
    )
    rates = success_rates(table)
    return {
        "figure": pictures.add(by_kind(rates, EXPERIMENT)),
        "totals": [
            {
                "arranging": most,
                "often": int((rates[most] > OFTEN).sum()),
                "never": int((rates[most] == 0).sum()),
                "mean": f"{100 * rates[most].mean():.1f} %",
            }
            for most in arranging(rates)
        ],
        "actions": len(rates),
        "untried": max(0, _all_actions() - len(rates)),
        "worst": _worst(rates),
        "shown": min(WORST_SHOWN, len(rates)),
    }


def success_rates(table: pd.DataFrame) -> pd.DataFrame:
    """A row an action and start: class, crossings of the start, and a success rate in a column for
    each number of arranging splines; not measured is NaN."""
    starts = table["start"].drop_duplicates()
    crossings = {start: TopologicalState.parse(start).num_crossings for start in starts}
    table = table.assign(
        rate=table["successes"] / table["trials"], crossings=table["start"].map(crossings)
    )
    one = ["start", "action", "class", "crossings"]
    return table.pivot(index=one, columns="arranging", values="rate").reset_index()


def _all_actions() -> int:
    """All actions that lead to at most MOST_CROSSINGS, up to Mirror and Reverse."""
    states = [state for count in range(MOST_CROSSINGS) for state in all_states(count)]
    return sum(
        onward.num_crossings <= MOST_CROSSINGS
        for state in states
        if representative(state)[0] == state
        for _, onward in distinct_actions(state)
    )


def _worst(rates: pd.DataFrame) -> str:
    """The actions that succeed least often, by the trials that arrange most."""
    limits = arranging(rates)
    own = rates.sort_values([*reversed(limits), "crossings"], kind="stable").head(WORST_SHOWN)
    lines = [
        [f"`{start}`", f"`{action}`", kind, *(f"{100 * rate:.0f} %" for rate in shares)]
        for start, action, kind, _, *shares in own.itertuples(index=False)
    ]
    header = ["start", "action", "kind", *(f"{most} arranging" for most in limits)]
    return markdown_table(header, lines, "lll" + "r" * len(limits))


SECTION = Section(
    EXPERIMENT,
    "All actions",
    "Not in the paper",
    "Which actions the primitives can do, among all that lead to at most three crossings, from "
    "ropes that searches brought into the start state.",
    values,
)

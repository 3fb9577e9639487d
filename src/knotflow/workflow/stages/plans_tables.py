"""Stages that bring searches into the committed tables: `plans_table` and `plans_success`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from knotflow.intervals import wilson
from knotflow.planning import KnotPlan
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import SEARCHES, read_searches


@dataclass
class PlansTableConfig:
    """How the inputs are distinguished."""

    column: str = ""
    """Name of the column, in front of the others, that holds an input's name; "" for none."""


@stage("plans_table", version=2)
def tabulate(config: PlansTableConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes branches.csv, a row a search, and tried.csv, where its branches went: a row for each
    state and action, all searches of an input and start together.

    Inputs: `plans` stages, in the order of the table.
    """
    tables, tried = [], []
    for name, folder in inputs.items():
        table = read_searches(folder / SEARCHES)
        spent = _tried(folder, table)
        table = table.drop(columns="plan")
        if config.column:
            table.insert(0, config.column, name)
            spent.insert(0, config.column, name)
        tables.append(table)
        tried.append(spent)
    for file, all_of in (("branches.csv", tables), ("tried.csv", tried)):
        with context.atomic(file) as path:
            pd.concat(all_of, ignore_index=True).to_csv(path, index=False)


def _tried(folder: Path, searches: pd.DataFrame) -> pd.DataFrame:
    """Branches and successes of each state and action; those most tried first."""
    rows = [
        (search.start, str(one.state), str(one.action), one.branches, one.branches * one.success)
        for search in searches.itertuples()
        for one in KnotPlan.from_json(
            (folder / "plans" / f"{search.plan}.json").read_text("utf-8")
        ).tried
    ]
    keys = ["start", "state", "action"]
    table = pd.DataFrame(rows, columns=[*keys, "branches", "successes"])
    total = table.groupby(keys, sort=False, as_index=False).sum()
    return total.sort_values("branches", ascending=False, kind="stable")


@dataclass
class PlansSuccessConfig:
    """Nothing to choose."""


@stage("plans_success", inputs=("plans",))
def count(config: PlansSuccessConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes knots.csv: for each goal and start how many searches tied it, with what effort.

    Medians are over the searches that tied the knot, limits are 95 % Wilson.
    """
    rows = []
    searches = read_searches(inputs["plans"] / SEARCHES)
    for (goal, start), own in searches.groupby(["goal", "start"], sort=False):
        tied = own[own["solved"]]
        rate = wilson(len(tied), len(own))
        rows.append(
            {
                "goal": goal,
                "start": start,
                "searches": len(own),
                "tied": len(tied),
                "success_rate": rate.estimate,
                "ci_low": rate.low,
                "ci_high": rate.high,
                "branches_median": tied["branches"].median() if len(tied) else "",
                "seconds_median": tied["seconds"].median() if len(tied) else "",
                "confirmed": int((tied["confirmed"] == "yes").sum()),
            }
        )
    with context.atomic("knots.csv") as path:
        pd.DataFrame(rows).to_csv(path, index=False, float_format="%.6g")

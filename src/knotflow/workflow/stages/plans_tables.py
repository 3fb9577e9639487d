"""Stages that bring searches into the committed tables: `plans_table` and `plans_success`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from knotflow.intervals import wilson
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import SEARCHES, read_searches


@dataclass
class PlansTableConfig:
    """How the inputs are told apart."""

    column: str = ""
    """Name of the column, in front of the others, that holds an input's name; "" for none."""


@stage("plans_table")
def tabulate(config: PlansTableConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes branches.csv, a row a search.

    Inputs: `plans` stages, in the order of the table.
    """
    tables = []
    for name, folder in inputs.items():
        table = read_searches(folder / SEARCHES).drop(columns="plan")
        if config.column:
            table.insert(0, config.column, name)
        tables.append(table)
    with context.atomic("branches.csv") as path:
        pd.concat(tables, ignore_index=True).to_csv(path, index=False)


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

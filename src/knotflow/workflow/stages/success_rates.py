"""Stage `success_rates`: evaluations side by side, the table behind Fig. 6 and Fig. 7."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from knotflow.intervals import rate_columns
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass
class SuccessRatesConfig:
    """Nothing to choose."""


@stage("success_rates")
def tabulate(config: SuccessRatesConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes success_rates.csv, with 95 % Wilson intervals, and per_start.csv.

    Inputs: evaluations; their names are the methods, in the order of the table.
    """
    tables = [
        pd.read_csv(folder / "outcomes.csv").assign(method=method)
        for method, folder in inputs.items()
    ]
    outcomes = pd.concat(tables)
    rates = _count(outcomes, ["method", "action"])
    rates = rates.assign(**rate_columns(rates["successes"], rates["trials"]))
    with context.atomic("success_rates.csv") as path:
        rates.to_csv(path, index=False, float_format="%.6g")
    with context.atomic("per_start.csv") as path:
        _count(outcomes, ["method", "action", "start"]).to_csv(path, index=False)


def _count(outcomes: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Trials and successes by the given columns, in the order in which they appear."""
    counted = outcomes.groupby(by, sort=False)["success"].agg(["size", "sum"]).reset_index()
    return counted.rename(columns={"size": "trials", "sum": "successes"})

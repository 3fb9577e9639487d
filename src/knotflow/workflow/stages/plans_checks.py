"""Stage `plans_checks`: can every step of the plans that were found be relied on?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from knotflow.planning import KnotPlan, check_steps
from knotflow.simulation import SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass
class PlansChecksConfig:
    """What the plans were made in."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator they were planned with."""


@stage("plans_checks")
def check(config: PlansChecksConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes checks.csv, a row a step of every plan that reached its goal: see `planning.soundness`.

    Inputs: `plans` or `goals` stages.
    """
    rows = []
    for name, folder in context.progress(inputs.items(), desc="steps simulated again"):
        plans = {one.stem: KnotPlan.from_json(one.read_text("utf-8")) for one in _plans(folder)}
        steps = [
            (plan, number, step)
            for plan, found in plans.items()
            if found.solved
            for number, step in enumerate(found.steps)
        ]
        checks = check_steps([step for *_, step in steps], config.simulation)
        for (plan, number, step), outcome in zip(steps, checks, strict=True):
            rows.append((name, plan, number, str(step.action), len(outcome.passages),
                         outcome.reproduced, outcome.steady))  # fmt: skip
    columns = ["searches", "plan", "step", "action", "passages", "reproduced", "steady"]
    with context.atomic("checks.csv") as path:
        pd.DataFrame(rows, columns=columns).to_csv(path, index=False)


def _plans(folder: Path) -> list[Path]:
    return sorted((folder / "plans").glob("*.json"))

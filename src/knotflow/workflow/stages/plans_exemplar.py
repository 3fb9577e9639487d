"""Stage `plans_exemplar`: one of many plans, with everything there is to look at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from knotflow.planning import KnotPlan
from knotflow.samplers import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import SEARCHES, read_searches
from knotflow.workflow.stages.plans_files import write_plan


@dataclass
class PlansExemplarConfig:
    """Which plan is shown."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """What it was planned in."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method that proposed its splines."""


@stage("plans_exemplar", version=1, inputs=("plans",))
def show(config: PlansExemplarConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes plan/ with the files of `plans_files.write_plan`.

    The plan shown is the solved one of fewest branches, the first of equals; where no search was
    solved, the one that came nearest, that is with the most steps.
    """
    searches = read_searches(inputs["plans"] / SEARCHES)
    plans = {
        name: KnotPlan.from_json((inputs["plans"] / "plans" / f"{name}.json").read_text("utf-8"))
        for name in searches["plan"]
    }
    best = min(plans, key=lambda name: (not plans[name].solved, _effort(plans[name]), name))
    write_plan(context, "plan", plans[best], config.simulation, config.sampler.name)


def _effort(plan: KnotPlan) -> int:
    return plan.branches if plan.solved else -len(plan.steps)

"""Stages that show plans: `plans_exemplar`, one of many, and `plans_dag`, the ways to a knot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from knotflow.planning import KnotPlan, SolutionDag, parse_goal, replay
from knotflow.planning.pull import PullConfig
from knotflow.samplers.sampler import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.topology import TopologicalState
from knotflow.viz.plan_folder import write_plan_folder
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import SEARCHES, read_searches


@dataclass
class PlansExemplarConfig:
    """Which plan is shown."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """What it was planned in."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method that proposed its splines."""


@stage("plans_exemplar", inputs=("plans",))
def show(config: PlansExemplarConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes plan/ with the files of `write_plan_folder`.

    The plan shown is the solved one of fewest branches, the first of equals; where no search was
    solved, the one that came nearest, that is with the most steps.
    """
    searches = read_searches(inputs["plans"] / SEARCHES)
    plans = {
        name: KnotPlan.from_json((inputs["plans"] / "plans" / f"{name}.json").read_text("utf-8"))
        for name in searches["plan"]
    }
    best = min(plans, key=lambda name: (not plans[name].solved, _effort(plans[name]), name))
    plan, rope = replay(plans[best], config.simulation), config.simulation.rope
    with context.atomic("plan") as folder:
        folder.mkdir()
        write_plan_folder(folder, plan, config.sampler.name, rope, signature=context.signature)


def _effort(plan: KnotPlan) -> int:
    return plan.branches if plan.solved else -len(plan.steps)


@dataclass
class PlansDagConfig:
    """What is drawn."""

    path: str = PullConfig.path
    """A topological path from the trivial state; its end is the goal, and it is highlighted."""


@stage("plans_dag", inputs=())
def picture(config: PlansDagConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes dag.png and dag.svg with every topological path to the state at the end of `path`."""
    from knotflow.viz.dag import draw_dag

    along = parse_goal(config.path).dag
    actions, state = [], TopologicalState.trivial()
    while edges := along.edges_from(state):
        action, state = edges[0]
        actions.append(action)
    with context.atomic("dag.png") as png, context.atomic("dag.svg") as svg:
        draw_dag(SolutionDag.to(state), [png, svg], actions)

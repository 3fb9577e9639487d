"""Stages that show plans: `plans_exemplar`, one of many, and `plans_dag`, the ways to a knot.

Pictures load matplotlib, which is slow to import, and most stages draw nothing: so it is imported
where something is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from knotflow.planning import KnotPlan, SolutionDag, parse_goal
from knotflow.planning.pull import PullConfig
from knotflow.planning.shown import coarse, played, shown_dag
from knotflow.recording import write_recording
from knotflow.samplers import SamplerConfig
from knotflow.simulation import Attempts, SimulationConfig
from knotflow.topology import TopologicalState
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import SEARCHES, read_searches
from knotflow.workflow.stages.recorder import recorded


@dataclass
class PlansExemplarConfig:
    """Which plan is shown."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """What it was planned in."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method that proposed its splines."""


@stage("plans_exemplar", inputs=("plans",))
def show(config: PlansExemplarConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes plan/ with the files of `write_plan`.

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


@dataclass
class PlansDagConfig:
    """What is drawn."""

    path: str = PullConfig.path
    """A topological path from the trivial state; its end is the goal, and it is highlighted."""


@stage("plans_dag", inputs=())
def picture(config: PlansDagConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes dag.png and dag.svg with every topological path to the state at the end of `path`."""
    from knotflow.planning.draw_dag import draw_dag

    along = parse_goal(config.path).dag
    actions, state = [], TopologicalState.trivial()
    while edges := along.edges_from(state):
        action, state = edges[0]
        actions.append(action)
    with context.atomic("dag.png") as png, context.atomic("dag.svg") as svg:
        draw_dag(SolutionDag.to(state), [png, svg], actions)


def write_plan(
    context: StageContext,
    folder: str,
    plan: KnotPlan,
    simulation: SimulationConfig,
    source: str,
    last_tried: Attempts | None = None,
) -> None:
    """Write plan.json, plan.png, plan.svg, plan.gif, plan.mcap, waypoints.csv and dag.png, dag.svg.

    The steps are simulated again, to have them at 50 frames per second. A plan without steps has
    nothing to play: its animation is a still, and its recording shows `last_tried`.

    Args:
        context: of the stage.
        folder: where to, in the stage's folder.
        plan: solved or not, with or without trajectories.
        simulation: what it was planned in.
        source: who proposed the splines.
        last_tried: attempts of a search that got nowhere; without them there is no recording.
    """
    from knotflow.planning.animate import animate_plan
    from knotflow.planning.draw import draw_plan
    from knotflow.planning.draw_dag import draw_dag

    shown = played(plan, simulation)
    brief = coarse(plan, shown)
    for name in ("plan.png", "plan.svg"):
        with context.atomic(f"{folder}/{name}") as path:
            draw_plan(plan, path)
    with context.atomic(f"{folder}/plan.gif") as path:
        if brief.steps:
            animate_plan(brief, path)
        else:
            from PIL import Image

            Image.open(context.out / folder / "plan.png").convert("P").save(path, format="GIF")
    with context.atomic(f"{folder}/plan.json") as path:
        path.write_text(brief.to_json(), "utf-8")
    with context.atomic(f"{folder}/waypoints.csv") as path:
        brief.waypoints().to_csv(path)
    rolled = shown or ([last_tried] if last_tried is not None else [])
    if rolled:
        rollouts = [
            rollout
            for number, attempts in enumerate(rolled)
            for rollout in recorded(
                attempts, simulation.rope, source, context.signature, number * len(attempts)
            )
        ]
        with context.atomic(f"{folder}/plan.mcap") as path:
            facts = {"goal": plan.goal, "solved": str(plan.solved), "source": source}
            write_recording(path, rollouts, facts)
    dag = shown_dag(plan)
    with context.atomic(f"{folder}/dag.png") as png, context.atomic(f"{folder}/dag.svg") as svg:
        draw_dag(dag, [png, svg], plan.actions if plan.solved else (), plan.start_state)

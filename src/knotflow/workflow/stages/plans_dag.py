"""Stage `plans_dag`: the solution DAG of a knot as a picture (Fig. 1, top)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from knotflow.planning import SolutionDag, parse_goal
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass
class PlansDagConfig:
    """What is drawn."""

    path: str = "R1(0,1,1) C(0,1,1) C(2,0,1)"
    """A topological path from the trivial state; its end is the goal, and it is highlighted."""


@stage("plans_dag", version=1, inputs=())
def picture(config: PlansDagConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes dag.png and dag.svg with every topological path to the state at the end of `path`."""
    # Only here, because matplotlib is slow to import and most stages draw nothing.
    from knotflow.planning.draw_dag import draw_dag
    from knotflow.topology import TopologicalState

    along = parse_goal(config.path).dag
    actions, state = [], TopologicalState.trivial()
    while edges := along.edges_from(state):
        action, state = edges[0]
        actions.append(action)
    with context.atomic("dag.png") as png, context.atomic("dag.svg") as svg:
        draw_dag(SolutionDag.to(state), [png, svg], actions)

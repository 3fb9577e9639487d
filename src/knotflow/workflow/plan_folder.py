"""The folder of a plan: all that there is to look at and to give to a robot.

Pictures load matplotlib, which is slow to import, and most stages draw nothing: so it is imported
where something is drawn.
"""

from __future__ import annotations

from knotflow.planning import KnotPlan
from knotflow.planning.shown import coarse, played, shown_dag
from knotflow.recording import recorded, write_recording
from knotflow.simulation import Attempts, SimulationConfig

from .context import StageContext


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
    from knotflow.viz.animation import animate_plan
    from knotflow.viz.dag import draw_dag
    from knotflow.viz.plan import draw_plan

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

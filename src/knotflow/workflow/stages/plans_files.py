"""The files of one plan: for people to look at, and for a robot to execute."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from knotflow.planning import KnotPlan, SolutionDag
from knotflow.recording import write_recording
from knotflow.simulation import Attempts, RopeSimulator, SimulationConfig, attempt
from knotflow.workflow.context import StageContext
from knotflow.workflow.stages.recorder import recorded

RECORD_RATE = 50.0
"""Frames a second of the recording; every fifth of them is in the animation."""
ANIMATED = 5
DRAWN_STATES = 40
"""A larger solution DAG is drawn as the plan's path alone: it would be slow, and illegible."""


def write_plan(
    context: StageContext,
    folder: str,
    plan: KnotPlan,
    simulation: SimulationConfig,
    source: str,
    last_tried: Attempts | None = None,
) -> None:
    """Write plan.json, plan.png, plan.svg, plan.gif, plan.mcap, waypoints.csv and dag.png, dag.svg.

    The steps are simulated again, to have them at 50 frames a second. A plan without steps has
    nothing to play: its animation is a still, and its recording shows `last_tried`.

    Args:
        context: of the stage.
        folder: where to, in the stage's folder.
        plan: solved or not, with or without trajectories.
        simulation: what it was planned in.
        source: who proposed the splines.
        last_tried: attempts of a search that got nowhere; without them there is no recording.
    """
    # Only here, because matplotlib is slow to import and most stages draw nothing.
    from knotflow.planning.animate import animate_plan
    from knotflow.planning.draw import draw_plan
    from knotflow.planning.draw_dag import draw_dag

    shown = _played(plan, simulation)
    coarse = _coarse(plan, shown)
    for name in ("plan.png", "plan.svg"):
        with context.atomic(f"{folder}/{name}") as path:
            draw_plan(plan, path)
    with context.atomic(f"{folder}/plan.gif") as path:
        if coarse.steps:
            animate_plan(coarse, path)
        else:
            from PIL import Image

            Image.open(context.out / folder / "plan.png").convert("P").save(path, format="GIF")
    with context.atomic(f"{folder}/plan.json") as path:
        path.write_text(coarse.to_json(), "utf-8")
    with context.atomic(f"{folder}/waypoints.csv") as path:
        coarse.waypoints().to_csv(path)
    played = shown or ([last_tried] if last_tried is not None else [])
    if played:
        rollouts = [
            rollout
            for number, attempts in enumerate(played)
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


def shown_dag(plan: KnotPlan) -> SolutionDag:
    """What is drawn: all ways to the state that was tied, or to a goal that was not.

    From the rope's start state on; where these are too many to see anything, only the plan's own.
    """
    goals = [plan.states[-1]] if plan.solved else plan.goal_states
    ways = (SolutionDag.to(goal) for goal in goals)
    dag = next(dag for dag in ways if plan.start_state in dag).after(plan.start_state)
    if len(dag) <= DRAWN_STATES:
        return dag
    if plan.steps:
        return SolutionDag.along(plan.actions, plan.start_state)
    actions, state = [], plan.start_state
    while state not in dag.goals:
        action, state = min(dag.edges_from(state), key=lambda edge: dag.distance(edge[1]))
        actions.append(action)
    return SolutionDag.along(actions, plan.start_state)


def _played(plan: KnotPlan, simulation: SimulationConfig) -> list[Attempts]:
    """Every step again, at the rate of the recording; the same physics, so the same end."""
    simulator = RopeSimulator(replace(simulation, record_rate=RECORD_RATE))
    return [
        attempt(simulator, step.start, step.spline[None], step.action, step.start_state)
        for step in plan.steps
    ]


def _coarse(plan: KnotPlan, played: Sequence[Attempts]) -> KnotPlan:
    """The plan with every fifth frame, the first and the last among them."""
    steps = []
    for step, again in zip(plan.steps, played, strict=True):
        rollouts = again.rollouts
        kept = [*range(len(rollouts.times) - 1, 0, -ANIMATED), 0][::-1]
        steps.append(
            replace(
                step,
                times=rollouts.times[kept],
                trajectory=rollouts.trajectory[0, kept],
                gripper=rollouts.gripper[0, kept],
            )
        )
    return replace(plan, steps=tuple(steps))

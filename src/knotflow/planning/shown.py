"""What is shown of a plan: its steps played again, few of the frames, the ways to its goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from knotflow.planning.dag import SolutionDag
from knotflow.planning.plan import KnotPlan
from knotflow.planning.search_graph import SearchGraph
from knotflow.simulation import Attempts, RopeSimulator, SimulationConfig, attempt
from knotflow.topology import Undo

RECORD_RATE = 50.0
"""Frames per second of the recording; every fifth of them is in the animation."""
ANIMATED = 5
DRAWN_STATES = 40
"""A larger solution DAG is drawn as the plan's path alone: it would be slow, and illegible."""


def played(plan: KnotPlan, simulation: SimulationConfig) -> list[Attempts]:
    """Every step again, at the rate of the recording; the same physics, so the same end."""
    simulator = RopeSimulator(replace(simulation, record_rate=RECORD_RATE))
    return [
        attempt(simulator, step.start, step.spline[None], step.action, step.start_state)
        for step in plan.steps
    ]


def coarse(plan: KnotPlan, played: Sequence[Attempts]) -> KnotPlan:
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


def shown_dag(plan: KnotPlan) -> SolutionDag:
    """What is drawn: all ways to the state that was tied, or to a goal that was not.

    From the rope's start state on; only the plan's own where these are too many to see anything, or
    where it takes crossings back.
    """
    undoes = any(isinstance(action, Undo) for action in plan.actions)
    goals = [plan.states[-1]] if plan.solved else plan.goal_states
    ways = (SolutionDag.to(goal) for goal in goals)
    dag = None if undoes else next((dag for dag in ways if plan.start_state in dag), None)
    if dag is None and not plan.steps:  # a rope whose crossings were to be undone first
        dag = SearchGraph(SolutionDag.to(*goals), plan.start_state)
    if dag is not None and len(after := dag.after(plan.start_state)) <= DRAWN_STATES:
        return after
    if plan.steps:
        return SolutionDag.along(plan.actions, plan.start_state)
    assert dag is not None
    actions, state = [], plan.start_state
    while state not in dag.goals:
        action, state = min(dag.edges_from(state), key=lambda edge: dag.distance(edge[1]))
        actions.append(action)
    return SolutionDag.along(actions, plan.start_state)

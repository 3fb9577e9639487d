"""The one way from a knot's name and a rope to a plan, for commands, studio and experiments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.config import FAST_SEARCH, PlannerConfig
from knotflow.planning.goals import parse_goal
from knotflow.planning.nodes import Progress
from knotflow.planning.plan import KnotPlan, PlanStep
from knotflow.planning.tree import plan_knot
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import Observer, RopeSimulator, SimulationConfig, attempt
from knotflow.threads import one_thread
from knotflow.topology import TopologicalState

RECORD_RATE = 50.0
"""Frames per second of a plan's trajectories; see `plan_rope`."""


class AlreadyTiedError(ValueError):
    """A rope that is in a goal state before anything is planned."""


def plan_rope(
    points: NDArray[np.float64],
    knot: str,
    rng: np.random.Generator,
    *,
    sampler: Sampler,
    simulation: SimulationConfig | None = None,
    config: PlannerConfig | None = None,
    progress: Progress | None = None,
    observe: Observer | None = None,
) -> KnotPlan:
    """Plan how to tie a knot into a rope.

    Args:
        points: (V, 3) the rope at rest, metres, head first.
        knot: a name, crossings or a path of actions, see `parse_goal`.
        rng: everything random comes from it.
        sampler: proposes splines.
        simulation: rope and simulator. It is recorded at `RECORD_RATE`, which changes no shape, so
            that the plan can be animated and stored without simulating it again.
        config: the search; `FAST_SEARCH` if None.
        progress: called after every batch.
        observe: called with every batch's attempts.

    Returns:
        The plan with its trajectories, solved or not.

    Raises:
        AlreadyTiedError: the rope is in a goal state.
        ValueError: an unknown knot, or one that cannot be reached from this rope; see `parse_goal`
            and `plan_knot`.
    """
    simulation = replace(simulation or SimulationConfig(), record_rate=RECORD_RATE)
    goal = parse_goal(knot, simulation.rope)
    state = TopologicalState.from_curve(points)
    if state in goal.states:
        raise AlreadyTiedError(
            f"there is nothing to plan: the rope is in the state {state}, which is {knot} already"
        )
    simulator = RopeSimulator(simulation)
    with one_thread():
        return plan_knot(
            points, goal, sampler, simulator, rng, config or FAST_SEARCH, progress, observe
        )


def replay(plan: KnotPlan, simulation: SimulationConfig) -> KnotPlan:
    """A plan stored without trajectories with those of its steps, simulated again."""
    simulator = RopeSimulator(replace(simulation, record_rate=RECORD_RATE))
    steps = []
    for step in plan.steps:
        rollouts = simulator.execute(step.start[None], step.spline[None])
        frames = {"trajectory": rollouts.trajectory[0], "gripper": rollouts.gripper[0]}
        steps.append(replace(step, times=rollouts.times, **frames))
    return replace(plan, steps=tuple(steps))


def estimate_success(
    step: PlanStep,
    rng: np.random.Generator,
    simulation: SimulationConfig | None = None,
    repeats: int = 32,
) -> float:
    """The share of disturbed repetitions of a step that reach its state.

    The gripper misses the grasp by 5 mm along the rope and each control point by 5 mm per axis
    (standard deviations), about what a calibrated arm does.
    """
    from knotflow.samplers.demonstrations import NoiseConfig, noisy_copies

    simulation = simulation or SimulationConfig()
    noise = NoiseConfig(grasp=0.005 / simulation.rope.length, middle=0.005, end=0.005)
    splines = noisy_copies(step.spline, repeats, rng, noise)
    simulator = RopeSimulator(simulation)
    tried = attempt(simulator, step.start, splines, step.action, step.start_state)
    return float(tried.success.mean())

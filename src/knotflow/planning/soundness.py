"""Whether a plan's steps can be relied on: simulated again, by frame, finer and for longer.

A state is read when the rope is nearly at rest, so a strand that slipped through another one on the
way would go unnoticed; what hangs by the time step is an accident of the simulation; and a rope
that was bent tightly goes on unbending, by centimetres in seconds, after it was let go: of 40
overhands of which nothing but the time step was checked, four came undone by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from knotflow.planning.passing import StrandPassage, find_passages
from knotflow.planning.plan_step import PlanStep
from knotflow.simulation import RopeSimulator, SimulationConfig, end_states

HELD = 3.0
"""Seconds after a step's end for which its state has to last."""
AT_ONCE = 64
"""Steps that are simulated together; all their frames are kept meanwhile."""


@dataclass(frozen=True)
class StepCheck:
    """What became of a step that was simulated again from the shape it began with.

    Attributes:
        passages: strands that passed through others on the way.
        reproduced: it reached its state again, at the same time step.
        steady: it reached its state at half the time step, too, and was still in it `HELD` later.
    """

    passages: tuple[StrandPassage, ...]
    reproduced: bool
    steady: bool


def check_steps(steps: Sequence[PlanStep], simulation: SimulationConfig) -> list[StepCheck]:
    """Simulate steps again: `simulation`, with every time step recorded, and see `are_steady`."""
    every = RopeSimulator(replace(simulation, record_rate=1.0 / simulation.timestep))
    checks = []
    for first in range(0, len(steps), AT_ONCE):
        some = steps[first : first + AT_ONCE]
        starts = np.stack([step.start for step in some])
        splines = np.stack([step.spline for step in some])
        rollouts = every.execute(starts, splines)
        found = rollouts.trajectory, end_states(rollouts), are_steady(some, simulation)
        for step, trajectory, again, steady in zip(some, *found, strict=True):
            passages = tuple(find_passages(trajectory))
            checks.append(StepCheck(passages, again == step.end_state, steady))
    return checks


def are_steady(steps: Sequence[PlanStep], simulation: SimulationConfig) -> list[bool]:
    """Whether steps reach their states at half the time step of `simulation`, and keep them."""
    settled = simulation.settle_time + HELD
    finer = replace(simulation, timestep=simulation.timestep / 2, settle_time=settled)
    starts = np.stack([step.start for step in steps])
    rollouts = RopeSimulator(finer).execute(starts, np.stack([step.spline for step in steps]))
    return [end == step.end_state for end, step in zip(end_states(rollouts), steps, strict=True)]

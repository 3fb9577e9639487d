"""Whether a plan's steps are reliable: simulated again with all frames, finer and for longer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.plan import KnotPlan, PlanStep
from knotflow.simulation import RopeSimulator, SimulationConfig, end_states
from knotflow.topology import DegenerateCurveError
from knotflow.topology.polyline import Floats, planar_crossings

RECORD_RATE = 50.0  # frames per second of a plan's trajectories; no shape depends on it
HOLD_TIME = 3.0  # seconds after a step's end for which its state has to last
CHUNK = 64  # steps that are simulated at once; all their frames are kept in memory
MAX_SHIFT = 1.5
"""Links by which a crossing may move along either strand between two frames to be the same."""


@dataclass(frozen=True)
class StepCheck:
    """The result of simulating a step again from the shape it began with."""

    penetrations: Floats  # see `find_penetrations`
    reproduced: bool  # whether it reached its state again, at the same time step
    steady: bool  # see `are_robust`


def check_steps(steps: Sequence[PlanStep], simulation: SimulationConfig) -> list[StepCheck]:
    """Simulate steps again with every time step recorded, and as `are_robust` does."""
    simulator = RopeSimulator(replace(simulation, record_rate=1.0 / simulation.timestep))
    checks = []
    for first in range(0, len(steps), CHUNK):
        chunk = steps[first : first + CHUNK]
        rollouts = simulator.execute(*_inputs(chunk))
        found = end_states(rollouts), are_robust(chunk, simulation)
        for row, (step, end, robust) in enumerate(zip(chunk, *found, strict=True)):
            penetrations = find_penetrations(rollouts.motion(row).trajectory)
            checks.append(StepCheck(penetrations, end == step.end_state, robust))
    return checks


def are_robust(steps: Sequence[PlanStep], simulation: SimulationConfig) -> list[bool]:
    """Whether steps reach their states at half the time step and keep them for `HOLD_TIME`."""
    finer = replace(
        simulation,
        timestep=simulation.timestep / 2,
        rest_speed=0.0,
        settle_time=simulation.settle_time + HOLD_TIME,
    )
    rollouts = RopeSimulator(finer).execute(*_inputs(steps))
    return [end == step.end_state for end, step in zip(end_states(rollouts), steps, strict=True)]


def _inputs(steps: Sequence[PlanStep]) -> tuple[Floats, Floats]:
    return np.stack([step.start for step in steps]), np.stack([step.spline for step in steps])


def replay(plan: KnotPlan, simulation: SimulationConfig) -> KnotPlan:
    """A plan stored without trajectories with those of its steps, simulated again."""
    simulator = RopeSimulator(replace(simulation, record_rate=RECORD_RATE))
    steps = []
    for step in plan.steps:
        rollouts = simulator.execute(step.start[None], step.spline[None])
        steps.append(replace(step, **vars(rollouts.motion(0))))
    return replace(plan, steps=tuple(steps))


def find_penetrations(trajectory: NDArray[np.float32]) -> Floats:
    """Every crossing of a trajectory (T, V, 3), metres, whose strands pass through each other.

    Over and under can be exchanged only around an end of the rope, which removes the crossing. So
    one that is found again nearby, with the same turn and its strands in the other order, is a
    penetration. Degenerate frames are skipped.

    Returns:
        (n, 3) the first frame with the strands in exchanged order, and positions on both strands
        from the head, fractions of the rope's length.
    """
    found = []
    before: Floats | None = None
    for frame, points in enumerate(np.asarray(trajectory, np.float64)):
        now = _crossings(points)
        if now is None:
            continue
        if before is not None and len(before) and len(now):
            found += [(frame, *row / (len(points) - 1)) for row in _exchanged(before, now)]
        before = now
    return np.array(found).reshape(-1, 3)


def _crossings(points: Floats) -> Floats | None:
    """(c, 4) position on both strands in links, turn, and height of the first over the second."""
    try:
        met = planar_crossings(points[:, :2])
    except DegenerateCurveError:
        return None
    if met.degenerate:
        return None
    first, second = (
        points[link, 2] + along * (points[link + 1, 2] - points[link, 2])
        for link, along in ((met.first, met.first_along), (met.second, met.second_along))
    )
    positions = met.first + met.first_along, met.second + met.second_along
    return np.column_stack([*positions, met.turn, first - second])


def _exchanged(before: Floats, now: Floats) -> Floats:
    """(n, 2) positions of the crossings in another order than the nearest one before."""
    apart = np.abs(before[:, None, :2] - now[None, :, :2]).max(axis=-1)
    apart[before[:, None, 2] != now[None, :, 2]] = np.inf
    # The same crossing: each the other's nearest.
    nearest, back = apart.argmin(axis=0), apart.argmin(axis=1)
    columns = np.arange(len(now))
    same = (back[nearest] == columns) & (apart[nearest, columns] <= MAX_SHIFT)
    return np.asarray(now[same & (before[nearest, 3] * now[:, 3] < 0), :2])

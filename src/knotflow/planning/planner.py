"""From a rope and a knot to a plan, for command, studio and experiments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotflow.planning.certainty import SurvivalConfig
from knotflow.planning.config import FAST_SEARCH, PlannerConfig
from knotflow.planning.goals import Goal, parse_goal
from knotflow.planning.hand import Reach
from knotflow.planning.plan import KnotPlan
from knotflow.planning.survival import SurvivalSearch
from knotflow.planning.tree import Progress, TreeSearch
from knotflow.planning.validation import RECORD_RATE
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import Observer, RopeSimulator, SimulationConfig
from knotflow.threads import one_thread
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats


def plan_rope(
    points: Floats,
    knot: str | Goal,
    rng: np.random.Generator,
    *,
    sampler: Sampler,
    simulation: SimulationConfig | None = None,
    config: PlannerConfig | None = None,
    progress: Progress | None = None,
    observe: Observer | None = None,
    survival: SurvivalConfig | None = None,
    reach: Reach | None = None,
    earlier: KnotPlan | None = None,
    stoppable: bool = False,
    early: bool = False,
) -> KnotPlan:
    """Plan how to tie a knot into a rope; the plan has its trajectories, solved or not.

    The rope (V, 3), metres, head first, is at rest; the knot is a goal, or a name, crossings or a
    path of actions, see `parse_goal`. Simulation is recorded at `RECORD_RATE`; the default of
    `config` is `FAST_SEARCH`. With `survival` the search continues until a plan succeeds in other
    worlds; `early` leaves out those that can no longer change this. With `reach` it accepts only
    what an arm can follow. If `stoppable`, Ctrl-C then ends it with the best plan so far. For the
    other arguments see `plan_knot`.

    Raises:
        ValueError: an unknown knot, one that is tied already, or one that cannot be reached from
            this rope; see `parse_goal` and `plan_knot`.
    """
    simulation = replace(simulation or SimulationConfig(), record_rate=RECORD_RATE)
    goal = knot if isinstance(knot, Goal) else parse_goal(knot, simulation.rope)
    state = TopologicalState.from_curve(points)
    if state in goal.states:
        raise ValueError(
            f"there is nothing to plan: the rope is in the state {state}, which is {goal.name} "
            "already"
        )
    search = TreeSearch(
        points,
        goal,
        sampler,
        RopeSimulator(simulation),
        rng,
        config or FAST_SEARCH,
        observe,
        reach,
        earlier,
    )
    with one_thread():
        if survival is None or not survival.worlds:
            return search.run(progress)
        return SurvivalSearch(search, survival, rng, early).run(progress, stoppable)

"""Which of all actions a library can do, with and without arranging."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.experiments.common import sampler_of
from knotflow.planning import Goal, PlannerConfig, attempt_arranged, plan_knot
from knotflow.samplers import SamplerConfig
from knotflow.samplers.primitives import primitive_of
from knotflow.seeding import rng_of
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, attempt, random_curve
from knotflow.topology import TopologicalState, all_states
from knotflow.topology.symmetry import distinct_actions, representative
from knotflow.workflow import StageRun, stage

CLASSES = {1: "R1", 2: "R2", 3: "Cross, end over", 4: "Cross, end under"}
"""What the table calls the actions of each primitive."""


@stage
def actions(
    run: StageRun,
    *,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    most_crossings: int = 3,
    count: int,
    arranging: int,
    seed: int,
) -> None:
    """Trials of every action, those that Mirror and Reverse turn into each other once.

    Makes actions.csv (start, action, class, arranging, trials, successes); one shard a state. Start
    shapes are tied as a plan meets them, each from a random rope by a search.

    `count` start shapes in each state, and trials of each action; at most `arranging` splines of a
    trial make room before the one that acts.
    """
    states = [state for crossings in range(most_crossings) for state in all_states(crossings)]
    names = [str(state) for state in states if representative(state)[0] == state]
    rope = simulation.rope

    def start_shapes(
        state: TopologicalState, simulator: RopeSimulator, rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Ropes (N, V, 3) in a state; fewer than wanted where searches for it give up."""
        tying, found = sampler_of(sampler, primitives=primitives), []
        for _ in range(count):
            start = random_curve(rope, rng, starts)
            if not state.num_crossings:
                found.append(start)
                continue
            plan = plan_knot(start, Goal.state(state), tying, simulator, rng, planner)
            if plan.solved:
                found.append(plan.shapes[-1])
        return np.array(found).reshape(-1, rope.num_vertices, 3)

    def try_actions(name: str) -> pd.DataFrame:
        state, rng = TopologicalState.parse(name), rng_of(seed, names.index(name))
        simulator, tried = RopeSimulator(simulation), sampler_of(sampler, primitives=primitives)
        points = start_shapes(state, simulator, rng)
        rows = []
        for action, end in distinct_actions(state):
            if end.num_crossings > most_crossings or not len(points):
                continue
            splines = np.concatenate([tried.sample(shape, action, 1, rng) for shape in points])
            single = attempt(simulator, points, splines, action, state)
            several, _ = attempt_arranged(points, action, state, tried, simulator, rng, arranging)
            kind = CLASSES[primitive_of(action, state.num_segments)]
            for most, success in ((0, single.success), (arranging, several)):
                rows.append((name, str(action), kind, most, len(points), int(success.sum())))
        columns = ["start", "action", "class", "arranging", "trials", "successes"]
        return pd.DataFrame(rows, columns=columns)

    run.table("actions.csv", try_actions, names, "actions")

"""Stage `actions`: which of all actions a library can do, with and without arranging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.planning import Goal, PlannerConfig, attempt_arranged, plan_knot
from knotflow.samplers.primitives import primitive_of
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, attempt, random_curve
from knotflow.topology import TopologicalState, all_states
from knotflow.topology.symmetry import distinct_actions, representative
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage

TABLE = "actions.csv"
CLASSES = {1: "R1", 2: "R2", 3: "Cross, end over", 4: "Cross, end under"}
"""What the table calls the actions of each primitive."""


@dataclass(kw_only=True)
class ActionsConfig:
    """Which actions are tried, and how often."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the splines."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What the ropes look like from which start shapes are tied."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method; the stages it learns from are inputs of this one."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """The search that ties the start shapes."""
    most_crossings: int = 3
    """Of the states that actions lead to."""
    count: int
    """Start shapes in each state, and trials of each action."""
    arranging: int
    """Most arranging splines of a trial that arranges."""
    seed: int
    """Of start shapes and trials; used for nothing else."""


@stage("actions")
def try_actions(config: ActionsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes actions.csv: start, action, class, arranging, trials, successes.

    States and actions that Mirror and Reverse turn into each other are tried once. Start shapes are
    tied as a plan meets them, each from a random rope by a search; one shard a state.
    """
    names = [str(state) for state in start_states(config.most_crossings)]
    context.table(TABLE, partial(_try, config, dict(inputs)), names, "actions")


def start_states(most_crossings: int) -> list[TopologicalState]:
    """A state of each class under Mirror and Reverse that allows an action within the limit."""
    found = [state for count in range(most_crossings) for state in all_states(count)]
    return [state for state in found if representative(state)[0] == state]


def _try(
    config: ActionsConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> pd.DataFrame:
    state = TopologicalState.parse(name)
    number = [str(one) for one in start_states(config.most_crossings)].index(name)
    rng = np.random.default_rng([config.seed, number])
    simulator = RopeSimulator(config.simulation)
    sampler = build_sampler(config.sampler, inputs)
    points = _start_shapes(state, config, inputs, simulator, rng)
    rows = []
    for action, onward in distinct_actions(state):
        if onward.num_crossings > config.most_crossings or not len(points):
            continue
        splines = np.concatenate([sampler.sample(rope, action, 1, rng) for rope in points])
        single = attempt(simulator, points, splines, action, state)
        several = attempt_arranged(points, action, state, sampler, simulator, rng, config.arranging)
        kind = CLASSES[primitive_of(action, state.num_segments)]
        for most, success in ((0, single.success), (config.arranging, several.success)):
            rows.append((name, str(action), kind, most, len(points), int(success.sum())))
    columns = ["start", "action", "class", "arranging", "trials", "successes"]
    return pd.DataFrame(rows, columns=columns)


def _start_shapes(
    state: TopologicalState,
    config: ActionsConfig,
    inputs: Mapping[str, Path],
    simulator: RopeSimulator,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Ropes (N, V, 3) in a state; fewer than wanted where searches for it give up."""
    sampler, rope = build_sampler(config.sampler, inputs), config.simulation.rope
    found = []
    for _ in range(config.count):
        start = random_curve(rope, rng, config.starts)
        if not state.num_crossings:
            found.append(start)
            continue
        plan = plan_knot(start, Goal.state(state), sampler, simulator, rng, config.planner)
        if plan.solved:
            found.append(plan.shapes[-1])
    return np.array(found).reshape(-1, rope.num_vertices, 3)

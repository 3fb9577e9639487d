"""Stage `goals`: searches for states drawn at random among all with so many crossings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.planning import Goal
from knotflow.recording import write_index
from knotflow.simulation import random_curve
from knotflow.topology import TopologicalState, all_states
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import (
    SearchesConfig,
    recorded_search,
    search_row,
)
from knotflow.workflow.workers import WorkersConfig

TABLE = "goals.csv"


@dataclass
class GoalSet:
    """States with equally many crossings."""

    name: str
    """What the table calls it."""
    crossings: int
    """Of every state of the set."""
    count: int
    """Goals that are drawn, none twice."""


@dataclass(kw_only=True)
class GoalsConfig(SearchesConfig):
    """Which goals are drawn, and how each is searched for."""

    sets: list[GoalSet]
    """Each of its goals is searched for once, from a random rope of its own."""
    seed: int
    """Of goals, ropes and searches; used for nothing else."""


@stage("goals")
def search_goals(config: GoalsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes goals.csv, plans/*.json of the plans found, and recordings/*.mcap of all branches.

    One shard a goal. Searches run one after the other: the seconds they take on all cores are a
    result.
    """
    goals = drawn_goals(config.sets, config.seed)
    alone = replace(context, workers=WorkersConfig(jobs=1))
    alone.table(TABLE, partial(_search, config, dict(inputs), goals), [*goals], "goals")
    write_index(context.out / "recordings")


def drawn_goals(sets: list[GoalSet], seed: int) -> dict[str, tuple[str, int, TopologicalState]]:
    """Each search's name, its set, the seed of its rope, and its goal."""
    drawn = {}
    for one in sets:
        states = all_states(one.crossings)
        rng = np.random.default_rng([seed, one.crossings])
        for number, row in enumerate(rng.permutation(len(states))[: one.count]):
            drawn[f"{one.name}-{number:03d}"] = (one.name, number, states[row])
    return drawn


def _search(
    config: GoalsConfig,
    inputs: Mapping[str, Path],
    goals: Mapping[str, tuple[str, int, TopologicalState]],
    context: StageContext,
    name: str,
) -> pd.DataFrame:
    chosen, number, state = goals[name]
    rope, crossings = config.simulation.rope, state.num_crossings
    of_rope, of_search = (
        np.random.default_rng([config.seed, crossings, number, part]) for part in (0, 1)
    )
    points, goal = random_curve(rope, of_rope, config.starts), Goal.state(state)
    place = [*goals].index(name)
    plan = recorded_search(config, inputs, context, name, place, points, goal, of_search)
    row = search_row(plan, str(state), "random", number)
    columns = ["solved", "branches", "seconds", "nodes", "path", "knot_type", "confirmed", "reason"]
    facts = {"set": chosen, "goal": row["goal"], "rope_seed": number}
    return pd.DataFrame([facts | {column: row[column] for column in columns}])

"""Stage `plans`: tree searches for knots from given ropes, seed by seed (Sec. V-B d, VII-A4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.planning import (
    ROPE_NAMES,
    Goal,
    KnotPlan,
    PlannerConfig,
    expected_type,
    knot_type,
    parse_goal,
    parse_rope,
    plan_knot,
)
from knotflow.planning.pull import tie
from knotflow.recording import write_index
from knotflow.samplers.demonstrations import aim
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, tangled
from knotflow.topology import TopologicalState
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder
from knotflow.workflow.workers import WorkersConfig

TANGLED = "tangled"
START_FILE = "start.npy"
"""A rope (V, 3) in the output of a stage that makes a start shape."""
SEARCHES = "searches.csv"
"""The table that this stage makes."""
NOT_CHECKED = "not checked"
"""In place of a knot type where topoly, an extra for tests, is not installed."""


@dataclass
class PlanCase:
    """One kind of search."""

    goal: str = "overhand"
    """A knot's name, crossings, or one topological path, see `planning.parse_goal`."""
    start: str = "straight"
    """straight, arc, random (another curve for each seed), tangled (another for each seed, in a
    state of one to three crossings from which no actions lead to the goal), a topological path
    (another for each seed, tied along it from straight, as the search leaves it), or an input that
    holds a start.npy."""


@dataclass(kw_only=True)
class SearchesConfig:
    """How is searched."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator the search plans in."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a random start looks like."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method; the stages it learns from are inputs of this one."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """How the tree grows, and when a search gives up."""


@dataclass(kw_only=True)
class PlansConfig(SearchesConfig):
    """What is planned, how often, and how."""

    cases: list[PlanCase] = field(default_factory=list)
    """Each is searched once for each seed."""
    seeds: int
    """Searches of each case."""
    seed: int
    """Of everything random. The start of a seed is the same for every method and goal."""


@stage("plans")
def make_plans(config: PlansConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes searches.csv, plans/*.json of the plans found, and recordings/*.mcap of all branches.

    One shard a case and seed; a shard is complete when its row is there. Inputs: what the sampler
    needs, and the starts that the cases name.
    """
    for case in config.cases:
        parse_goal(case.goal, config.simulation.rope)
        _check_start(case.start, config, inputs)
    names = _names(config)
    # A search of one branch after the other uses one core, so others may run beside it. One in
    # batches has all cores, and the seconds it takes with them are a result: it runs alone.
    if config.planner.batch > 1:
        context = replace(context, workers=WorkersConfig(jobs=1))
    context.table(SEARCHES, partial(_search, config, dict(inputs)), [*names], "plans")
    if any((context.out / "recordings").glob("*.mcap")):
        write_index(context.out / "recordings")


def _names(config: PlansConfig) -> dict[str, tuple[int, int]]:
    """Each search's name, and the numbers of its case and seed."""
    return {
        f"{number:02d}-{seed:03d}": (number, seed)
        for number in range(len(config.cases))
        for seed in range(config.seeds)
    }


def _search(
    config: PlansConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> pd.DataFrame:
    names, rope = _names(config), config.simulation.rope
    number, seed = names[name]
    case, rng = config.cases[number], np.random.default_rng([config.seed, seed, 1])
    points, goal = _start(case, config, seed, inputs), parse_goal(case.goal, rope)
    place = [*names].index(name)
    plan = recorded_search(config, inputs, context, name, place, points, goal, rng)
    return pd.DataFrame([{"plan": name} | search_row(plan, case.goal, case.start, seed)])


def recorded_search(
    config: SearchesConfig,
    inputs: Mapping[str, Path],
    context: StageContext,
    name: str,
    place: int,
    points: NDArray,
    goal: Goal,
    rng: np.random.Generator,
) -> KnotPlan:
    """Search for a goal from a rope (V, 3), and write plans/<name>.json and recordings/<name>.mcap;
    `place` among all searches of the stage numbers its rollouts."""
    first = place * config.planner.max_branches
    recorder = Recorder(context, config.sampler.name, config.simulation.rope, first)
    recorder.extra = {"plan": name}
    sampler, simulator = build_sampler(config.sampler, inputs), RopeSimulator(config.simulation)
    plan = plan_knot(points, goal, sampler, simulator, rng, config.planner, observe=recorder)
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"plans/{name}.json") as path:
        path.write_text(plan.to_json(trajectories=False), "utf-8")
    return plan


def search_row(plan: KnotPlan, goal: str, start: str, seed: int) -> dict[str, Any]:
    """What the tables say of one search; `knot_type` is reported by an independent library."""
    found, confirmed = _confirmed(plan)
    return {
        "start": start,
        "seed": seed,
        "branches": plan.branches,
        "solved": plan.solved,
        "seconds": round(plan.seconds, 3),
        "goal": goal,
        "nodes": plan.nodes,
        "path": " ".join(map(str, plan.actions)) if plan.solved else "",
        "knot_type": found,
        "confirmed": confirmed,
        "reason": plan.reason,
    }


def read_searches(path: Path) -> pd.DataFrame:
    """A table of searches; cells that are empty stay empty text."""
    return pd.read_csv(path, keep_default_na=False, dtype={"plan": str})


def _check_start(start: str, config: PlansConfig, inputs: Mapping[str, Path]) -> None:
    if _is_path(start):
        parse_goal(start, config.simulation.rope)
    elif start not in (*ROPE_NAMES, TANGLED) and start not in inputs:
        raise ValueError(
            f"unknown start {start!r}; it is one of {', '.join((*ROPE_NAMES, TANGLED))}, a path of "
            f"actions, or an input of this stage that holds a {START_FILE}: "
            f"{', '.join(inputs) or 'there is none'}"
        )


def _is_path(start: str) -> bool:
    return "(" in start


def _start(
    case: PlanCase, config: PlansConfig, seed: int, inputs: Mapping[str, Path]
) -> NDArray[np.float64]:
    """The rope (V, 3) of a seed, metres."""
    rng = np.random.default_rng([config.seed, seed, 0])
    if case.start in ROPE_NAMES:
        return parse_rope(case.start, config.simulation.rope, rng, config.starts)
    if case.start == TANGLED:
        dag = parse_goal(case.goal, config.simulation.rope).dag
        simulator = RopeSimulator(config.simulation)
        return tangled(lambda state: state not in dag, simulator, aim, rng, config.starts)
    if _is_path(case.start):
        sampler, simulator = build_sampler(config.sampler, inputs), RopeSimulator(config.simulation)
        planner = PlannerConfig(batch=config.planner.batch)
        return tie(parse_goal(case.start, config.simulation.rope), sampler, simulator, rng, planner)
    return np.load(inputs[case.start] / START_FILE, allow_pickle=False)


def _confirmed(plan: KnotPlan) -> tuple[str, str]:
    """The knot type of a tied rope, and whether it is that of its state: yes, no, not checked."""
    if not plan.solved:
        return "", ""
    try:
        found, expected = knot_type(plan.shapes[-1]), _expected(plan.states[-1])
    except ModuleNotFoundError:
        return NOT_CHECKED, NOT_CHECKED
    return found, "yes" if found == expected else "no"


@cache
def _expected(state: TopologicalState) -> str:
    return expected_type(state)

"""Plans beyond the planner's world: executed open loop in others, and on ropes that labs have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from knotflow.experiments.common import sampler_of
from knotflow.planning import KnotPlan, PlannerConfig, SurvivalConfig, plan_rope, surviving
from knotflow.planning.rope.size import RopeSize
from knotflow.samplers import SamplerConfig
from knotflow.seeding import rng_of
from knotflow.simulation import (
    GRIPPER_ERROR_STD,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    WorldsConfig,
    draw_worlds,
    random_curve,
)
from knotflow.workflow import StageRun, stage

DISTURBANCES = {
    "pace": WorldsConfig(level=0),
    "level_1": WorldsConfig(level=1),
    "level_2": WorldsConfig(level=2),
    **{
        f"twin_{level}": WorldsConfig(level, 1.0, 1.0, error)
        for level, error in enumerate(GRIPPER_ERROR_STD)
    },
}
"""Worlds that plans are executed in: half to twice the pace with level 0, 1 and 2 of physics, and
those of a twin at each level: physics and gripper errors, at the planned pace."""


@stage
def robustness(
    run: StageRun,
    *,
    primitives: Path,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    survival: SurvivalConfig,
    knot: str,
    seeds: int,
    worlds: int,
    seed: int,
) -> None:
    """Plans for a knot from random ropes, executed open loop in `worlds` of each of `DISTURBANCES`.

    Makes robustness.csv, a row a rope and disturbance; a rope without a plan ties in none. One
    shard a rope.
    """

    def execute(name: str) -> pd.DataFrame:
        number = int(name)
        points = random_curve(simulation.rope, rng_of(seed, number, 0), starts)
        proposer = sampler_of(sampler, primitives=primitives)
        plan = plan_rope(
            points, knot, rng_of(seed, number, 1), sampler=proposer, simulation=simulation,
            config=planner, survival=survival,
        )  # fmt: skip
        simulator, rng = RopeSimulator(simulation), rng_of(seed, number, 2)
        rows = []
        for disturbance, spread in DISTURBANCES.items():
            drawn = draw_worlds(simulation.rope, worlds, rng, spread)
            tied = surviving(plan.steps, simulator, drawn)[-1] if plan.solved else 0
            rows.append((disturbance, number, worlds, tied, plan.branches, round(plan.seconds, 3)))
        columns = ["disturbance", "rope_seed", "worlds", "tied", "simulated", "seconds"]
        return pd.DataFrame(rows, columns=columns)

    run.table("robustness.csv", execute, [f"{one:03d}" for one in range(seeds)], "ropes")


@dataclass
class LabRope:
    """A rope that a lab may have; metres."""

    name: str
    length: float
    diameter: float
    bending_length: float
    """(EI / w)^(1/3) of its stiffness EI and weight w a metre."""


@stage
def lab_ropes(
    run: StageRun,
    *,
    primitives: Path,
    cases: list[LabRope],
    knots: list[str],
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    survival: SurvivalConfig,
    survival_branches: int,
    seeds: int,
    seed: int,
) -> None:
    """Plans for ropes of several sizes, each simulated in units of its length.

    "exact" is solved where there is a plan; "level_1" where the plan that survives best, of a
    search of `survival_branches` splines at most, ties open loop in one fresh world. Makes
    ropes.csv; one shard a rope, knot and seed.
    """
    chosen = {
        f"{case.name}-{knot}-{number:03d}": (case, knot, number)
        for case in cases
        for knot in knots
        for number in range(seeds)
    }

    def search(name: str) -> pd.DataFrame:
        case, knot, number = chosen[name]
        size = RopeSize(case.length, case.diameter, case.bending_length)
        own = replace(simulation, rope=size.model())
        points = random_curve(own.rope, rng_of(seed, number, 0), starts)
        proposer = sampler_of(sampler, primitives=primitives)

        def plan(config: PlannerConfig, chosen_by: SurvivalConfig | None) -> KnotPlan:
            return plan_rope(
                points, knot, rng_of(seed, number, 1), sampler=proposer, simulation=own,
                config=config, survival=chosen_by,
            )  # fmt: skip

        first = plan(planner, None)
        rows = [("exact", number, first.solved, first.branches)]
        solved, simulated = False, survival_branches
        if first.solved and first.branches < survival_branches:  # the other begins alike
            sure = plan(replace(planner, max_branches=survival_branches), survival)
            worlds = draw_worlds(own.rope, 1, rng_of(seed, number, 2), DISTURBANCES["level_1"])
            tied = surviving(sure.steps, RopeSimulator(own), worlds)[-1]
            solved, simulated = tied == 1, sure.branches
        rows.append(("level_1", number, solved, simulated))
        table = pd.DataFrame(rows, columns=["disturbance", "rope_seed", "solved", "simulated"])
        facts = vars(case) | {"knot": knot}
        for place, (column, value) in enumerate(facts.items()):
            table.insert(place, "rope" if column == "name" else column, value)
        return table

    run.table("ropes.csv", search, [*chosen], "ropes and knots")


@stage
def by_method(run: StageRun, *, robustness: Mapping[str, Path]) -> None:
    """The tables of several ways to plan as one, robustness.csv."""
    parts = [
        pd.read_csv(folder / "robustness.csv").assign(method=name)
        for name, folder in robustness.items()
    ]
    table = pd.concat(parts, ignore_index=True)
    run.save_table("robustness.csv", table[["method", *table.columns.drop("method")]])

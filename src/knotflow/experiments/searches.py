"""Tree searches for knots (Sec. V-B d, VII-A4, VII-B2, VII-E) and what is told of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.experiments.common import SEED, Recorder, distinct, sampler_of
from knotflow.planning import (
    ROPE_NAMES,
    Goal,
    KnotPlan,
    PlannerConfig,
    SearchUpdate,
    SolutionDag,
    check_steps,
    parse_goal,
    parse_rope,
    plan_knot,
    plan_rope,
    replay,
)
from knotflow.planning.head_pull import PATH, loop_area, pull_head
from knotflow.samplers import Sampler, SamplerConfig
from knotflow.samplers.demonstrations import heuristic_splines
from knotflow.seeding import rng_of
from knotflow.simulation import (
    Attempts,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    random_curve,
    random_tangle,
    straight,
)
from knotflow.statistics import rate_columns
from knotflow.topology import TopologicalState, all_states
from knotflow.viz.plan_folder import write_plan_folder
from knotflow.workflow import StageRun, stage

TANGLED = "tangled"
START_FILE = "start.npy"
"""A rope (V, 3) in the output of a stage that makes a start shape."""
FIRST_PULL = 1_000_000
"""Number of the first pull; expansions of the searches that tie are numbered from 0 on."""


@dataclass
class SearchCase:
    """One kind of search."""

    goal: str = "overhand"
    """A knot's name, crossings, or one topological path, see `planning.parse_goal`."""
    start: str = "straight"
    """straight, arc, random (another curve for each seed), tangled (another for each seed, in a
    state of one to three crossings from which no actions lead to the goal), or "pulled", the input
    of that name."""


@dataclass
class GoalSet:
    """States drawn at random among all with equally many crossings."""

    name: str
    """What the table calls it."""
    crossings: int
    """Of every state of the set."""
    count: int
    """Goals that are drawn, none twice."""


def _search(
    run: StageRun, simulation: SimulationConfig, planner: PlannerConfig, source: str,
    build: Callable[[], Sampler], name: str, number: int, points: NDArray[np.float64], goal: Goal,
    rng: np.random.Generator,
) -> KnotPlan:  # fmt: skip
    """Search from a rope (V, 3); write plans/<name>.json and recordings/<name>.mcap."""
    recorder = Recorder(run, source, simulation.rope, number * planner.max_branches)
    recorder.extra = {"plan": name}
    simulator = RopeSimulator(simulation)
    plan = plan_knot(points, goal, build(), simulator, rng, planner, observe=recorder)
    recorder.save(f"recordings/{name}.mcap")
    with run.atomic(f"plans/{name}.json") as path:
        path.write_text(plan.to_json(trajectories=False), "utf-8")
    return plan


@stage
def searches(
    run: StageRun,
    *,
    demonstrations: Path | None = None,
    primitives: Path | None = None,
    pulled: Path | None = None,
    cases: list[SearchCase],
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    seeds: int,
    seed: int,
) -> None:
    """Each case searched once for each seed; the start of a seed is the same for all methods.

    Makes searches.csv, plans/*.json and recordings/*.mcap; one shard a case and seed. A search of
    one expansion after the other uses one core, so others run beside it; one in batches has all.

    `pulled` holds a start.npy, for cases that start there. `seed` is of everything random.
    """
    rope = simulation.rope
    for case in cases:
        parse_goal(case.goal, rope)
        known = (*ROPE_NAMES, TANGLED, *(["pulled"] if pulled else []))
        if case.start not in known:
            raise ValueError(f"unknown start {case.start!r}; it is one of {', '.join(known)}")
    names = {
        f"{number:02d}-{one:03d}": (number, one)
        for number in range(len(cases))
        for one in range(seeds)
    }
    build = partial(sampler_of, sampler, demonstrations=demonstrations, primitives=primitives)
    searched = partial(_search, run, simulation, planner, sampler.name, build)

    def start_of(case: SearchCase, rng: np.random.Generator) -> NDArray[np.float64]:
        """The rope (V, 3) of a seed, metres."""
        if case.start in ROPE_NAMES:
            return parse_rope(case.start, rope, rng, starts)
        if case.start == TANGLED:
            simulator, dag = RopeSimulator(simulation), parse_goal(case.goal, rope).dag
            return random_tangle(
                lambda state: state not in dag, simulator, heuristic_splines, rng, starts
            )
        assert pulled is not None
        return np.asarray(np.load(pulled / START_FILE, allow_pickle=False))

    def search(name: str) -> pd.DataFrame:
        number, own_seed = names[name]
        case = cases[number]
        points = start_of(case, rng_of(seed, own_seed, 0))
        goal, place = parse_goal(case.goal, rope), [*names].index(name)
        plan = searched(name, place, points, goal, rng_of(seed, own_seed, 1))
        return pd.DataFrame([{"plan": name} | search_row(plan, case.goal, case.start, own_seed)])

    (run.alone() if planner.batch > 1 else run).table("searches.csv", search, [*names], "searches")


def search_row(plan: KnotPlan, goal: str, start: str, seed: int) -> dict[str, Any]:
    """What the tables say of one search; `kept` of its `simulated` splines are in the tree."""
    return {
        "start": start,
        "seed": seed,
        "kept": plan.kept,
        "simulated": plan.branches,
        "solved": plan.solved,
        "seconds": round(plan.seconds, 3),
        "goal": goal,
        "path": " ".join(map(str, plan.actions)) if plan.solved else "",
        "end_state": str(plan.states[-1]) if plan.solved else "",
        "reason": plan.reason,
    }


def read_searches(folder: Path) -> pd.DataFrame:
    """The table of a `searches` stage; cells that are empty stay empty text."""
    return pd.read_csv(folder / "searches.csv", keep_default_na=False, dtype={"plan": str})


@stage
def goals(
    run: StageRun,
    *,
    primitives: Path | None = None,
    sets: list[GoalSet],
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    seed: int,
) -> None:
    """Searches for states drawn at random, each once, from a random rope of its own.

    Makes goals.csv, plans/*.json and recordings/*.mcap; one shard a goal, one after the other.
    """
    drawn = {}
    for one in sets:
        states = all_states(one.crossings)
        rows = rng_of(seed, one.crossings).permutation(len(states))[: one.count]
        for number, row in enumerate(rows):
            drawn[f"{one.name}-{number:03d}"] = (one.name, number, states[row])
    build = partial(sampler_of, sampler, primitives=primitives)
    searched = partial(_search, run, simulation, planner, sampler.name, build)

    def search(name: str) -> pd.DataFrame:
        chosen, number, state = drawn[name]
        of_rope, of_search = (rng_of(seed, state.num_crossings, number, part) for part in (0, 1))
        points = random_curve(simulation.rope, of_rope, starts)
        plan = searched(name, [*drawn].index(name), points, Goal.state(state), of_search)
        row = search_row(plan, str(state), "random", number)
        row |= {"set": chosen, "rope_seed": number}
        columns = ["set", "goal", "rope_seed", "kept", "simulated", "solved", "seconds", "path"]
        return pd.DataFrame([row])[[*columns, "reason"]]

    run.alone().table("goals.csv", search, [*drawn], "goals")


@stage
def branches(run: StageRun, *, searches: Mapping[str, Path], columns: list[str]) -> None:
    """Searches side by side, with `columns` for the parts of the inputs' names, such as method.

    What is the same for every training, such as ICP, is there once, without a training seed. Makes
    branches.csv, a row a search, and tried.csv, how many splines were simulated for each state and
    action, and how many succeeded, of all trainings and seeds together.
    """
    found, spent = [], []
    for folder, names in distinct(searches, columns).items():
        table = read_searches(folder)
        spent.append(_tried(folder, table).assign(**names))
        table = table.drop(columns="plan").assign(**names)
        found.append(table)
    table = pd.concat(found, ignore_index=True)
    others = [name for name in columns if name != SEED]
    first = [*others, *(name for name in ("start", SEED) if name in table and name not in others)]
    run.save_table("branches.csv", table[[*first, *table.columns.drop(first)]])
    keys = [*dict.fromkeys([*others, "start"]), "state", "action"]
    total = pd.concat(spent).groupby(keys, sort=False, as_index=False)[["simulated", "successes"]]
    total = total.sum().sort_values("simulated", ascending=False, kind="stable")
    run.save_table("tried.csv", total.sort_values(others, kind="stable") if others else total)


def _tried(folder: Path, searches: pd.DataFrame) -> pd.DataFrame:
    """Splines simulated for each search, state and action, and their successes."""
    rows = [
        (search.start, str(one.state), str(one.action), one.branches, one.branches * one.success)
        for search in searches.itertuples()
        for one in read_plan(folder, search.plan).tried
    ]
    return pd.DataFrame(rows, columns=["start", "state", "action", "simulated", "successes"])


def read_plan(folder: Path, name: object) -> KnotPlan:
    """A plan that a search left."""
    return KnotPlan.from_json((folder / "plans" / f"{name}.json").read_text("utf-8"))


@stage
def success(run: StageRun, *, searches: Path) -> None:
    """How many searches tied each goal from each start, with what effort.

    Makes knots.csv; medians are over the searches that tied the knot, limits are 95 % Wilson.
    """
    efforts, rows = ["kept", "simulated", "seconds"], []
    for (goal, start), own in read_searches(searches).groupby(["goal", "start"], sort=False):
        medians = own[own["solved"]][efforts].median().add_suffix("_median")
        rows.append(
            {"goal": goal, "start": start, "searches": len(own)}
            | {"tied": own["solved"].sum()}
            | dict(medians)
        )
    table = pd.DataFrame(rows)
    for place, (name, values) in enumerate(
        rate_columns(table["tied"], table["searches"]).items(), 4
    ):
        table.insert(place, name, values)
    run.save_table("knots.csv", table, "%.6g")


@stage
def checks(run: StageRun, *, searches: Mapping[str, Path], simulation: SimulationConfig) -> None:
    """Every step of the plans found simulated again, see `planning.validation`.

    Makes checks.csv, a row a step.
    """
    rows = []
    names: dict[Path, str] = {}
    for name, folder in searches.items():
        names.setdefault(folder, name)  # what needs no training is the same for all
    for folder, name in run.progress(names.items(), desc="steps simulated again"):
        steps = [
            (file.stem, number, step)
            for file in sorted(folder.glob("plans/*"))
            if (plan := read_plan(folder, file.stem)).solved
            for number, step in enumerate(plan.steps)
        ]
        checked = check_steps([step for *_, step in steps], simulation)
        for (name_of_plan, number, step), outcome in zip(steps, checked, strict=True):
            facts = (len(outcome.penetrations), outcome.reproduced, outcome.steady)
            rows.append((name, name_of_plan, number, str(step.action), *facts))
    columns = ["searches", "plan", "step", "action", "passages", "reproduced", "steady"]
    run.save_table("checks.csv", pd.DataFrame(rows, columns=columns))


@stage
def exemplar_plan(
    run: StageRun, *, searches: Path, simulation: SimulationConfig, sampler: SamplerConfig
) -> None:
    """The solved plan of fewest splines; where none was solved, the one of most steps.

    Makes plan/, see `write_plan_folder`.
    """
    plans = {name: read_plan(searches, name) for name in read_searches(searches)["plan"]}

    def effort(name: str) -> tuple[bool, int, str]:
        plan = plans[name]
        return not plan.solved, plan.branches if plan.solved else -len(plan.steps), name

    with run.atomic("plan") as folder:
        folder.mkdir()
        plan = replay(plans[min(plans, key=effort)], simulation)
        write_plan_folder(folder, plan, sampler.name, simulation.rope, signature=run.key)


@stage
def overhand(
    run: StageRun,
    *,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    knot: str,
    start: str,
    seed: int,
) -> None:
    """A plan for one knot in one rope, with everything there is to look at (Fig. 1).

    Makes plan/ (see `write_plan_folder`), branches.csv, and recordings/ of all expansions.

    `start` is straight, arc, random, or a file, see `planning.parse_rope`; `knot` see `parse_goal`.

    Raises:
        ValueError: see `planning.plan_rope`; or no spline could be simulated in time.
    """
    rope = simulation.rope
    points = parse_rope(start, rope, rng_of(seed, 0), starts)
    recorder, last = Recorder(run, sampler.name, rope), list[Attempts]()

    def observe(attempts: Attempts) -> None:
        recorder(attempts)
        last[:] = [attempts]

    with run.progress(total=planner.max_branches, desc="splines") as bar:

        def progress(update: SearchUpdate) -> None:
            bar.update(update.branches - bar.n)

        plan = plan_rope(
            points, knot, rng_of(seed, 1), sampler=sampler_of(sampler, primitives=primitives),
            simulation=simulation, config=planner, progress=progress, observe=observe,
        )  # fmt: skip
    if not plan.branches:
        raise ValueError(f"no spline was simulated: {plan.reason}; raise planner.max_seconds")
    recorder.save("recordings/branches.mcap")
    run.save_table("branches.csv", pd.DataFrame([search_row(plan, knot, start, seed)]))
    with run.atomic("plan") as folder:
        folder.mkdir()
        write_plan_folder(folder, plan, sampler.name, rope, last_tried=last[0], signature=run.key)


@stage
def solution_dag(run: StageRun, *, path: str = PATH) -> None:
    """Every topological path to the state at the end of `path`, which is highlighted.

    Makes dag.png.
    """
    from knotflow.viz.dag import draw_dag

    along = parse_goal(path).dag
    actions, state = [], TopologicalState.trivial()
    while edges := along.edges_from(state):
        action, state = edges[0]
        actions.append(action)
    with run.atomic("dag.png") as png:
        draw_dag(SolutionDag.to(state), [png], actions)


@stage
def pull(
    run: StageRun,
    *,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    sampler: SamplerConfig,
    knots: int,
    seed: int = 40,
) -> None:
    """An overhand whose head is pulled out, as by hand (Sec. VII-E).

    Makes start.npy and start.csv of the rope (V, 3) in metres, and recordings/*.mcap.

    Of `knots` ropes tied and pulled, the one with the largest loop is taken.

    Raises:
        RuntimeError: none could be tied and pulled.
    """
    rope, simulator = simulation.rope, RopeSimulator(simulation)
    tying, pulls = Recorder(run, sampler.name, rope), Recorder(run, "pull", rope, FIRST_PULL)
    proposer, rng = sampler_of(sampler, primitives=primitives), np.random.default_rng(seed)
    goal, planner, ropes = parse_goal(PATH, rope), PlannerConfig(batch=16), []
    for _ in run.progress(range(knots), desc="pull"):
        plan = plan_knot(straight(rope), goal, proposer, simulator, rng, planner, observe=tying)
        pulled = pull_head(plan.shapes[-1], simulator, rng, pulls) if plan.solved else None
        ropes += [] if pulled is None else [pulled]
    if not ropes:
        raise RuntimeError(f"no head could be pulled out in {knots} knots; raise knots")
    points = max(ropes, key=loop_area)
    tying.save("recordings/tie.mcap")
    pulls.save("recordings/pull.mcap")
    run.save_table("start.csv", pd.DataFrame(points, columns=["x", "y", "z"]))
    with run.atomic(START_FILE) as path, path.open("wb") as file:
        np.save(file, points)

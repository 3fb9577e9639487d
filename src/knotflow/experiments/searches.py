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

from knotflow.experiments.common import Recorder, sampler_of
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
from knotflow.planning.head_pull import PATH, pull_head, select_best_pull, tie
from knotflow.samplers import Sampler, SamplerConfig
from knotflow.samplers.demonstrations import heuristic_splines
from knotflow.seeding import rng_of
from knotflow.simulation import (
    Attempts,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    attempt,
    random_curve,
    random_tangle,
)
from knotflow.statistics import rate_columns
from knotflow.topology import TopologicalState, all_states, parse_action
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
    state of one to three crossings from which no actions lead to the goal), a topological path
    (another for each seed, tied along it from straight), or "pulled", the input of that name."""


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
        _check_start(case.start, simulation, pulled)
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
        simulator = RopeSimulator(simulation)
        if case.start == TANGLED:
            dag = parse_goal(case.goal, rope).dag
            return random_tangle(
                lambda state: state not in dag, simulator, heuristic_splines, rng, starts
            )
        if "(" in case.start:
            tying = PlannerConfig()
            tying.batch = planner.batch
            return tie(parse_goal(case.start, rope), build(), simulator, rng, tying)
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
    """What the tables say of one search."""
    return {
        "start": start,
        "seed": seed,
        "branches": plan.branches,
        "solved": plan.solved,
        "seconds": round(plan.seconds, 3),
        "goal": goal,
        "nodes": plan.nodes,
        "path": " ".join(map(str, plan.actions)) if plan.solved else "",
        "end_state": str(plan.states[-1]) if plan.solved else "",
        "reason": plan.reason,
    }


def read_searches(folder: Path) -> pd.DataFrame:
    """The table of a `searches` stage; cells that are empty stay empty text."""
    return pd.read_csv(folder / "searches.csv", keep_default_na=False, dtype={"plan": str})


def _check_start(start: str, simulation: SimulationConfig, pulled: Path | None) -> None:
    if "(" in start:
        parse_goal(start, simulation.rope)
    elif start not in (*ROPE_NAMES, TANGLED) and (start, pulled is None) != ("pulled", False):
        raise ValueError(
            f"unknown start {start!r}; it is {', '.join((*ROPE_NAMES, TANGLED))}, a path of "
            f"actions, or pulled, where the stage has the input of that name"
        )


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
        columns = ["set", "goal", "rope_seed", "solved", "branches", "seconds", "nodes", "path"]
        return pd.DataFrame([row])[[*columns, "reason"]]

    run.alone().table("goals.csv", search, [*drawn], "goals")


@stage
def branches(run: StageRun, *, searches: Mapping[str, Path], column: str = "") -> None:
    """Searches side by side, with a column of the inputs' names if it is given one, such as start.

    Makes branches.csv, a row a search, and tried.csv, the expansions and successes of each state
    and action, of all searches of an input and start.
    """
    read = {name: read_searches(folder) for name, folder in searches.items()}
    spent = {name: _tried(searches[name], table) for name, table in read.items()}
    found = {name: table.drop(columns="plan") for name, table in read.items()}
    for file, tables in (("branches.csv", found), ("tried.csv", spent)):
        if column:
            for name, table in tables.items():
                tables[name] = table.drop(columns=column, errors="ignore")
                tables[name].insert(0, column, name)
        run.save_table(file, pd.concat(tables.values(), ignore_index=True))


def _tried(folder: Path, searches: pd.DataFrame) -> pd.DataFrame:
    """Expansions and successes of each state and action; those most tried first."""
    rows = [
        (search.start, str(one.state), str(one.action), one.branches, one.branches * one.success)
        for search in searches.itertuples()
        for one in read_plan(folder, search.plan).tried
    ]
    keys = ["start", "state", "action"]
    table = pd.DataFrame(rows, columns=[*keys, "branches", "successes"])
    total = table.groupby(keys, sort=False, as_index=False).sum()
    return total.sort_values("branches", ascending=False, kind="stable")


def read_plan(folder: Path, name: object) -> KnotPlan:
    """A plan that a search left."""
    return KnotPlan.from_json((folder / "plans" / f"{name}.json").read_text("utf-8"))


@stage
def success(run: StageRun, *, searches: Path) -> None:
    """How many searches tied each goal from each start, with what effort.

    Makes knots.csv; medians are over the searches that tied the knot, limits are 95 % Wilson.
    """
    rows = []
    for (goal, start), own in read_searches(searches).groupby(["goal", "start"], sort=False):
        tied = own[own["solved"]]
        medians = (tied[name].median() if len(tied) else "" for name in ("branches", "seconds"))
        rows.append((goal, start, len(own), len(tied), *medians))
    columns = ["goal", "start", "searches", "tied", "branches_median", "seconds_median"]
    table = pd.DataFrame(rows, columns=columns)
    rates = rate_columns(table["tied"], table["searches"])
    for place, (name, values) in enumerate(rates.items(), 4):
        table.insert(place, name, values)
    run.save_table("knots.csv", table, "%.6g")


@stage
def checks(run: StageRun, *, searches: Mapping[str, Path], simulation: SimulationConfig) -> None:
    """Every step of the plans found simulated again, see `planning.validation`.

    Makes checks.csv, a row a step.
    """
    rows = []
    for name, folder in run.progress(searches.items(), desc="steps simulated again"):
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
    """The solved plan of fewest expansions; where none was solved, the one of most steps.

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

    with run.progress(total=planner.max_branches, desc="branches") as bar:

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
def path_steps(
    run: StageRun,
    *,
    demonstrations: Path | None = None,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    path: str,
    ropes: list[str],
    shapes: int,
    splines: int,
    seed: int,
) -> None:
    """What each action of a path leaves for the next one.

    Makes steps.csv (of each rope on which an action was tried: start, action, shape, splines,
    successes, up to the first action that never succeeds) and recordings/*.mcap; one shard a start.

    Each action of `path` is tried from `shapes` ropes, drawn from the ends of the one before, by
    `splines` splines each; the first from `ropes`: straight, arc or random.
    """
    parse_goal(path, simulation.rope)
    rope = simulation.rope

    def try_path(name: str) -> pd.DataFrame:
        rng, simulator = rng_of(seed, ropes.index(name)), RopeSimulator(simulation)
        tried_by = sampler_of(sampler, demonstrations=demonstrations, primitives=primitives)
        current = np.repeat(parse_rope(name, rope, rng, starts)[None], shapes, axis=0)
        state = TopologicalState.from_curve(current[0])
        recorder, rows = Recorder(run, sampler.name, rope), []
        for action in map(parse_action, path.split()):
            ends: list[NDArray[np.float64]] = []
            for shape, points in enumerate(run.progress(current, desc=f"{action} from {name}")):
                proposed = tried_by.sample(points, action, splines, rng)
                tried = attempt(simulator, points, proposed, action, state, recorder)
                ends += list(tried.rollouts.end_points[tried.success])
                rows.append((name, str(action), shape, splines, int(tried.success.sum())))
            if not ends:
                break
            current = np.stack(ends)[rng.permutation(len(ends))[:shapes]]
            state = tried.goal
        recorder.save(f"recordings/{name}.mcap")
        return pd.DataFrame(rows, columns=["start", "action", "shape", "splines", "successes"])

    run.table("steps.csv", try_path, ropes, "path_steps")


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

    Of `knots` ropes tied and pulled, one is taken.

    Raises:
        RuntimeError: no knot could be tied, or none whose head could be pulled out far enough.
    """
    rope, simulator = simulation.rope, RopeSimulator(simulation)
    tying, pulls = Recorder(run, sampler.name, rope), Recorder(run, "pull", rope, FIRST_PULL)
    made, rng = sampler_of(sampler, primitives=primitives), np.random.default_rng(seed)
    ropes = [
        pull_head(made, simulator, rng, tying, pulls)
        for _ in run.progress(range(knots), desc="pull")
    ]
    points = select_best_pull(ropes)
    tying.save("recordings/tie.mcap")
    pulls.save("recordings/pull.mcap")
    run.save_table("start.csv", pd.DataFrame(points, columns=["x", "y", "z"]))
    with run.atomic(START_FILE) as path, path.open("wb") as file:
        np.save(file, points)

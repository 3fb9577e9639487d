"""Success rates of single actions (Sec. VII-A, VII-B1, Fig. 6 and 7), and of all of a library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.experiments.common import Recorder, point_rows, read_by_training, sampler_of
from knotflow.experiments.demonstrations import SHAPE_COLUMNS, load_starts
from knotflow.planning import Goal, PlannerConfig, attempt_arranged, plan_knot
from knotflow.recording import load, recorded, write_recording
from knotflow.samplers import SamplerConfig
from knotflow.samplers.demonstrations import (
    TASKS,
    NoiseConfig,
    heuristic_splines,
    noisy_copies,
    screened_splines,
)
from knotflow.samplers.primitives import PrimitiveLibrary, primitive_of
from knotflow.seeding import rng_of
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, attempt, random_curve
from knotflow.statistics import rate_columns
from knotflow.topology import TopologicalState, all_states
from knotflow.topology.symmetry import distinct_actions, representative
from knotflow.workflow import StageRun, stage

CLASSES = {1: "R1", 2: "R2", 3: "Cross, end over", 4: "Cross, end under"}
"""What the table calls the actions of each primitive."""
QUARTER = 4
"""Splines of each kind in a round of the search for a success."""


@stage
def evaluation(
    run: StageRun,
    *,
    evaluation_starts: Path,
    demonstrations: Path | None = None,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    sampler: SamplerConfig,
    trials_per_start: int,
    arranging: int = 0,
    seed: int,
) -> None:
    """How often a sampler's splines succeed.

    Makes outcomes.csv (action, start, success) and recordings/*.mcap; one shard a task.

    At most `arranging` splines of a trial make room before the one that acts; none in the paper.
    """
    names = [task.name for task in TASKS]

    def evaluate(name: str) -> pd.DataFrame:
        simulator = RopeSimulator(simulation)
        tried = sampler_of(sampler, demonstrations=demonstrations, primitives=primitives)
        number = names.index(name)
        task = TASKS[number]
        starts, rng = load_starts(evaluation_starts, task.name), rng_of(seed, number)
        first = number * len(starts) * trials_per_start * (1 + arranging)
        recorder = Recorder(run, sampler.name, simulation.rope, first)
        rows = []
        for start, points in enumerate(run.progress(starts, desc=f"evaluation of {task.action}")):
            recorder.extra = {"start": str(start)}
            way = (task.action, task.start_state)
            if arranging:
                ropes = np.repeat(points[None], trials_per_start, axis=0)
                hits, _ = attempt_arranged(ropes, *way, tried, simulator, rng, arranging, recorder)
            else:
                splines = tried.sample(points, task.action, trials_per_start, rng)
                hits = attempt(simulator, points, splines, *way, recorder).success
            rows += [(str(task.action), start, int(hit)) for hit in hits]
        recorder.save(f"recordings/{name}.mcap")
        return pd.DataFrame(rows, columns=["action", "start", "success"])

    run.table("outcomes.csv", evaluate, names, "evaluation")


@stage
def success_rates(run: StageRun, *, evaluations: Mapping[str, Path]) -> None:
    """Evaluations side by side, the names of the inputs being method and training seed.

    Makes success_rates.csv, with 95 % Wilson intervals, and per_start.csv.
    """
    outcomes = read_by_training(evaluations, "outcomes.csv")
    by = ["method", "action", "training_seed"]
    rates = _count(outcomes, by)
    rates = rates.assign(**rate_columns(rates["successes"], rates["trials"]))
    run.save_table("success_rates.csv", rates, "%.6g")
    run.save_table("per_start.csv", _count(outcomes, [*by, "start"]))


def _count(outcomes: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Trials and successes by the given columns, in the order in which they appear."""
    counted = outcomes.groupby(by, sort=False)["success"].agg(["size", "sum"]).reset_index()
    return counted.rename(columns={"size": "trials", "sum": "successes"})


@stage
def reachable(
    run: StageRun,
    *,
    evaluation_starts: Path,
    primitives: Path,
    simulation: SimulationConfig,
    noise: NoiseConfig,
    most: int = 256,
    seed: int,
) -> None:
    """From which starts one spline can do an action at all: a search that the simulator judges.

    Makes reachable.csv (action, start, splines, found) and recordings/*.mcap; one shard a task.

    In each round a quarter of the splines are aimed guesses, screened ones, the library's, and
    noisy copies of those whose ends were likest to the goal so far (`likeness`; in the first round,
    guesses again). A search stops at its first success, or after `most` splines.
    """
    names = [task.name for task in TASKS]

    def search(name: str) -> pd.DataFrame:
        number = names.index(name)
        task, rng = TASKS[number], rng_of(seed, number)
        simulator, library = RopeSimulator(simulation), PrimitiveLibrary.load(primitives)
        starts = load_starts(evaluation_starts, name)
        recorder = Recorder(run, "search", simulation.rope, number * len(starts) * most)
        samplers = (heuristic_splines, screened_splines, library.sample)

        def solve(points: NDArray[np.float64]) -> tuple[int, bool]:
            """Splines up to the first success, and whether there was one."""
            splines, likenesses = np.zeros((0, 6)), np.zeros(0)
            while len(splines) < most:
                best = splines[np.argsort(-likenesses, kind="stable")[: 2 * QUARTER]]
                proposed = [sample(points, task.action, QUARTER, rng) for sample in samplers]
                copied = rng.choice(best, QUARTER) if len(best) else proposed[0]
                proposed.append(noisy_copies(copied, QUARTER, rng, noise))
                tried = attempt(
                    simulator, points, np.concatenate(proposed), task.action, task.start_state,
                    recorder,
                )  # fmt: skip
                if tried.success.any():
                    return len(splines) + 1 + int(tried.success.argmax()), True
                ends = [likeness(end, task.goal_state) for end in tried.ends]
                splines = np.concatenate([splines, tried.splines])
                likenesses = np.concatenate([likenesses, ends])
            return most, False

        rows = []
        for start, points in enumerate(run.progress(starts, desc=f"search for {task.action}")):
            recorder.extra = {"start": str(start)}
            splines, found = solve(points)
            rows.append((str(task.action), start, splines, int(found)))
        recorder.save(f"recordings/{name}.mcap")
        return pd.DataFrame(rows, columns=["action", "start", "splines", "found"])

    run.table("reachable.csv", search, names, "reachable")


def likeness(end: TopologicalState | None, goal: TopologicalState) -> float:
    """How alike two states are, 0 to 1: the share of their Gauss codes' passages, over or under and
    of which sign, that come in the same order (Ratcliff and Obershelp). 0 of no state."""

    def code(state: TopologicalState) -> list[tuple[bool, int]]:
        passages = {over: (True, sign) for over, _, sign in state.crossings}
        passages |= {under: (False, sign) for _, under, sign in state.crossings}
        return [passages[position] for position in sorted(passages)]

    return SequenceMatcher(None, code(end), code(goal)).ratio() if end else 0.0


@stage
def exemplars(
    run: StageRun,
    *,
    evaluation_starts: Path,
    evaluation: Path,
    simulation: SimulationConfig,
    record_rate: float = 50.0,
) -> None:
    """A rollout of each task simulated again to look at, at `record_rate` frames per second.

    Makes recordings/<task>.mcap of the first success of each task, else of its first rollout.
    """
    simulation = replace(simulation, record_rate=record_rate)
    simulator, rollouts = RopeSimulator(simulation), load(evaluation / "recordings")
    for task in TASKS:
        own = rollouts[rollouts["action"] == str(task.action)]
        best = own.assign(hit=own["outcome"] == "success")
        row = best.sort_values(["hit", "number"], ascending=[False, True]).iloc[0]
        spline = row[[name for name in row.index if name.startswith("spline_")]]
        points = load_starts(evaluation_starts, task.name)[int(row["extra"]["start"])]
        splines = np.array([spline], dtype=float)
        tried = attempt(simulator, points, splines, task.action, task.start_state)
        with run.atomic(f"recordings/{task.name}.mcap") as path:
            facts = {"evaluation": evaluation.name}
            write_recording(path, recorded(tried, simulation.rope, row["source"], run.key), facts)


@stage
def proposals(
    run: StageRun, *, evaluation_starts: Path, evaluation: Path, ropes: int = 3, splines: int = 6
) -> None:
    """What a method proposed on the first `ropes` starts of each action, `splines` of each.

    Makes proposals.csv from recordings: a row a point in metres of the rope before (`before`, head
    first), of each spline's control points (`spline`), and of the rope after the first (`after`).

    Raises:
        ValueError: the evaluation recorded no spline for one of the starts.
    """
    tables = []
    for task in run.progress(TASKS, desc="proposals"):
        starts = load_starts(evaluation_starts, task.name)
        file = evaluation / "recordings" / f"{task.name}.mcap"
        rollouts = load(file, trajectories=True).sort_values("number")
        owner = np.array([int(extra["start"]) for extra in rollouts["extra"]])
        for start, points in enumerate(starts[:ropes]):
            own = rollouts[owner == start].head(splines)
            if own.empty:
                raise ValueError(f"the evaluation has no rollout of {task.action} from {start}")
            head = {"action": str(task.action), "start": start}
            tables.append(point_rows(points, what="before", proposal="", outcome="", **head))
            for proposal, row in enumerate(own.itertuples()):
                facts = head | {"proposal": proposal, "outcome": row.outcome}
                tables.append(point_rows(row.control_points, what="spline", **facts))
                if proposal == 0 and np.isfinite(row.points[-1]).all():  # it may have diverged
                    tables.append(point_rows(row.points[-1], what="after", **facts))
    table = pd.concat(tables, ignore_index=True)[SHAPE_COLUMNS]
    run.save_table("proposals.csv", table, "%.3f")


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

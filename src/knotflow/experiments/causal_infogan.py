"""Causal InfoGAN, trained on successful demonstrated rollouts, and its plans (Sec. VII-C)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.experiments.common import Recorder, read_by_training, train
from knotflow.experiments.demonstrations import load_starts
from knotflow.recording import load, read_recording
from knotflow.samplers.causal_infogan.data import (
    FRAMES,
    PLAN_STEPS,
    CausalInfoGanConfig,
    StartFrame,
)
from knotflow.samplers.causal_infogan.evaluation import (
    FOCUS,
    GOALS,
    OVERHAND,
    compare,
    measure,
    panel_rows,
    reachable_end,
)
from knotflow.samplers.demonstrations import TASKS, heuristic_splines, task
from knotflow.seeding import rng_of
from knotflow.simulation import Attempts, RopeSimulator, SimulationConfig, attempt
from knotflow.topology import Action, TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.training.trainer import CURVES
from knotflow.workflow import StageRun, stage


@stage
def causal_infogan(
    run: StageRun,
    *,
    demonstrations: Path,
    infogan: CausalInfoGanConfig,
    actions: list[str] = [],
    seeds: int,
) -> None:
    """Models of the rollouts of some actions, all eight by default, with seeds 0, 1 and so on.

    Makes models/<seed>.pt, training.csv (the curves) and seeds.csv (which have collapsed).
    """
    from knotflow.samplers.causal_infogan.networks import Health, save_model
    from knotflow.training.causal_infogan import CausalInfoGanTrainer

    chosen = [str(task(one).action) for one in actions] or [str(one.action) for one in TASKS]

    def train_model(shard: str) -> None:
        seed = int(Path(shard).name)
        starts, shapes = load_rollouts(demonstrations, chosen)
        framed = StartFrame.of(shapes[:, 0]).enter(shapes)
        trainer = CausalInfoGanTrainer(framed, starts, infogan, seed)
        name, folder = f"causal_infogan, seed {seed}", f"seed-{seed}"
        train(
            run, trainer, name, f"{shard}.pt",
            lambda path: save_model(path, trainer.model, chosen), folder=folder,
        )  # fmt: skip

    pending = run.pending([f"models/{seed}" for seed in range(seeds)], ".pt")
    run.each(train_model, pending, "causal_infogan")
    curves = []
    for seed in range(seeds):
        curve = pd.read_csv(run.out / f"seed-{seed}" / CURVES)
        curve.insert(0, "seed", seed)
        health = curve[[one.name for one in fields(Health)]].to_dict("records")
        curve["collapsed"] = [" ".join(Health(**row).collapsed) for row in health]
        curves.append(curve)
    run.save_table("training.csv", pd.concat(curves))
    run.save_table("seeds.csv", pd.concat([curve.tail(1) for curve in curves]))


def load_rollouts(
    demonstrations: Path, actions: Sequence[str], most: int = 0
) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Successful rollouts of some actions from the output of `demonstrations`.

    If given, `most` of them, spread evenly over the files.

    Returns:
        (N,) number of the demonstration, which has one start shape, and shapes (N, FRAMES, V, 3),
        metres, world frame.

    Raises:
        ValueError: not one rollout of these actions succeeded.
    """
    index = load(demonstrations / "recordings")
    index = index[index["action"].isin(list(actions)) & (index["outcome"] == "success")]
    if index.empty:
        raise ValueError(
            f"no rollout of {', '.join(actions)} in {demonstrations} succeeded, so there is "
            "nothing to learn from; simulate more copies (demonstrations.copies)"
        )
    if most:
        index = index.iloc[np.unique(np.linspace(0, len(index) - 1, most).astype(int))]
    starts: list[int] = []
    shapes: list[NDArray[np.float32]] = []
    for file, of_file in index.groupby("file", sort=True):
        wanted = set(of_file["number"])
        for rollout in read_recording(str(file)):
            if rollout.number in wanted:
                starts.append(int(rollout.extra["start"]))
                frames = np.linspace(0, len(rollout.points) - 1, FRAMES).round().astype(int)
                shapes.append(rollout.points[frames])
    return np.array(starts), np.stack(shapes)


@stage
def causal_infogan_ends(
    run: StageRun,
    *,
    evaluation_starts: Path,
    simulation: SimulationConfig,
    starts_focus: int,
    starts_other: int,
    starts_overhand: int,
    guesses: int = 16,
    rounds: int = 6,
    seed: int,
) -> None:
    """End shapes known to be reachable from unseen starts.

    Makes <goal>.npz with start (N,), points and ends (N, V, 3), metres; ends.csv and recordings.

    At most `starts_focus` starts of C(0,1,1), `starts_overhand` of the overhand, `starts_other` of
    each other action; `guesses` are executed at a time, `rounds` times for each action.
    """
    most = {goal.name: starts_other for goal in GOALS}
    most |= {FOCUS: starts_focus, OVERHAND: starts_overhand}
    names = [goal.file for goal in GOALS]

    def seek(name: str) -> None:
        number = names.index(name)
        goal, rng = GOALS[number], rng_of(seed, number)
        starts = load_starts(evaluation_starts, goal.first.name)[: most[goal.name]]
        recorder = Recorder(run, "aim", simulation.rope, number * 1_000_000)
        simulator = RopeSimulator(simulation)

        def propose(points: Floats, action: Action, state: TopologicalState) -> Attempts:
            splines = heuristic_splines(points, action, guesses, rng)
            return attempt(simulator, points, splines, action, state, recorder)

        found = {}
        for start, points in enumerate(starts):
            recorder.extra = {"start": str(start), "goal": goal.name}
            end = reachable_end(points, goal, propose, rounds)
            if end is not None:
                found[start] = (points, end)
        recorder.save(f"recordings/{name}.mcap")
        shape = (len(found), *starts.shape[1:])
        with run.atomic(f"{name}.npz") as path:
            np.savez_compressed(
                path,
                tried=len(starts),
                start=np.array(list(found), dtype=np.intp),
                points=np.array([one for one, _ in found.values()]).reshape(shape),
                ends=np.array([end for _, end in found.values()]).reshape(shape),
            )

    run.each(seek, run.pending(names, ".npz"), "reachable ends")
    rows = []
    for goal in GOALS:
        with np.load(run.out / f"{goal.file}.npz") as file:
            rows.append((goal.name, int(file["tried"]), len(file["start"])))
    run.save_table("ends.csv", pd.DataFrame(rows, columns=["goal", "starts", "reached"]))


@dataclass(frozen=True)
class _Query:
    """Given shapes of one goal: (N, V, 3) metres, world frame."""

    goal: str
    shapes: str  # "training" or "unseen"
    number: NDArray[np.intp]  # (N,) of the start, or of the demonstration
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    actions: int


@stage
def causal_infogan_plans(
    run: StageRun,
    *,
    demonstrations: Path,
    causal_infogan_ends: Path,
    models: Mapping[str, Path],
    evaluations: Mapping[str, Path],
    training_rows: int,
    seed: int,
) -> None:
    """Plans of rope shapes, measured, and beside samplers evaluated on the same starts.

    Makes plans.csv, panel.csv (shapes of Fig. 8), comparison.csv, training.csv and seeds.csv; one
    shard a model.

    `evaluations` are the methods of the comparison, by training; `training_rows` plans between
    shapes of the training data, for each model.
    """
    from knotflow.samplers.causal_infogan.networks import load_model
    from knotflow.samplers.causal_infogan.planning import Planner

    shards = [
        f"plans/{name}-{number}"
        for name, folder in models.items()
        for number in sorted(int(path.stem) for path in (folder / "models").glob("*.pt"))
    ]

    def plan(shard: str) -> None:
        name, _, number = Path(shard).name.rpartition("-")
        model, actions = load_model(models[name] / "models" / f"{number}.pt")
        planner, rows, shapes = Planner(model, seed), [], []
        for query in _queries(demonstrations, causal_infogan_ends, actions, training_rows):
            steps = PLAN_STEPS * query.actions
            plans = planner.plan(query.starts, query.ends, steps)
            for i, start in enumerate(query.number):
                drawn = (plans.projected_start[i], plans.way_points[i], plans.projected_end[i])
                head = {"model": name, "seed": int(number), "goal": query.goal}
                head |= {"shapes": query.shapes, "start": start}
                rows.append(head | asdict(measure(query.starts[i], *drawn, query.ends[i])))
                if query.goal in (FOCUS, OVERHAND) and i in (0, len(query.number) // 2):
                    shapes.append(panel_rows(rows[-1], query.starts[i], *drawn, query.ends[i]))
        run.save_table(f"panel/{name}-{number}.csv", pd.concat(shapes), "%.4f")
        run.save_table(f"{shard}.csv", pd.DataFrame(rows), "%.6g")

    run.each(plan, run.pending(shards, ".csv"), "plans")
    plans = pd.concat([pd.read_csv(run.out / f"{shard}.csv") for shard in shards])
    outcomes = read_by_training(evaluations, "outcomes.csv")
    tables = {
        "plans": plans,
        "panel": pd.concat([_panel(name, folder, run) for name, folder in models.items()]),
        "training": _of_models(models, "training"),
        "seeds": _of_models(models, "seeds"),
        "comparison": compare(plans, outcomes),
    }
    for name, table in tables.items():
        run.save_table(f"{name}.csv", table, "%.6g")


def _of_models(models: Mapping[str, Path], table: str) -> pd.DataFrame:
    return pd.concat(
        pd.read_csv(folder / f"{table}.csv", keep_default_na=False).assign(model=name)
        for name, folder in models.items()
    )


def _queries(
    demonstrations: Path, ends: Path, actions: list[str], training_rows: int
) -> Iterator[_Query]:
    """The given shapes of every goal a model was trained for, seen ones first."""
    each = -(-training_rows // len(actions))
    for action in actions:
        starts, shapes = load_rollouts(demonstrations, [action], each)
        first, last = shapes[:, 0].astype(float), shapes[:, -1].astype(float)
        yield _Query(action, "training", starts, first, last, 1)
    for goal in GOALS:
        if {str(action) for action in goal.actions} <= set(actions):
            with np.load(ends / f"{goal.file}.npz") as file:
                given = (file["start"], file["points"], file["ends"])
            if len(given[0]):
                yield _Query(goal.name, "unseen", *given, len(goal.actions))


def _panel(model: str, folder: Path, run: StageRun) -> pd.DataFrame:
    """The shapes of the first seed that has not collapsed, of the first one where all have."""
    seeds = pd.read_csv(folder / "seeds.csv", keep_default_na=False)
    healthy = seeds[seeds["collapsed"] == ""]
    seed = int((healthy if len(healthy) else seeds)["seed"].iloc[0])
    return pd.read_csv(run.out / "panel" / f"{model}-{seed}.csv")

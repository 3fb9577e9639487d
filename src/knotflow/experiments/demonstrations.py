"""Demonstrations and start shapes, from which all training begins (Sec. V-B a, VII-A1, VII-A3)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.experiments.common import Recorder, point_rows
from knotflow.samplers.demonstrations import (
    TASKS,
    DemonstratorConfig,
    NoiseConfig,
    heuristic_splines,
    load_demonstrations,
    noisy_copies,
    save_demonstrations,
)
from knotflow.samplers.demonstrations.scripted import Demonstrated, Demonstrator
from knotflow.seeding import rng_of
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    Trials,
    attempt,
    control_points,
    reach_starts,
    resample,
)
from knotflow.workflow import StageRun, stage

POOL_CHUNK = 32
"""Starts of a pool that are made at a time."""
SHAPE_COLUMNS = ["action", "start", "what", "proposal", "outcome", "point", "x", "y", "z"]


@stage
def demonstrations(
    run: StageRun,
    *,
    demonstrations_file: Path,
    simulation: SimulationConfig,
    noise: NoiseConfig,
    copies: int,
    copies_untangled: int,
    seed: int,
) -> None:
    """Simulate noisy copies of every demonstration.

    Makes recordings/*.mcap, trials/*.npz and success.csv; one shard a demonstration.

    `copies` are of a demonstration from a tangled start.
    """
    shown = load_demonstrations(demonstrations_file)
    names = [f"{number:03d}-{one.task.name}" for number, one in enumerate(shown)]
    counts = [copies if one.task.start_actions else copies_untangled for one in shown]

    def simulate_copies(name: str) -> None:
        number = names.index(name)
        one = shown[number]
        splines = noisy_copies(one.spline, counts[number], rng_of(seed, number), noise)
        points = resample(one.points, simulation.rope)
        recorder = Recorder(run, one.source, simulation.rope, sum(counts[:number]))
        recorder.extra = {"start": str(number)}
        simulator = RopeSimulator(simulation)
        tried = attempt(simulator, points, splines, one.task.action, one.task.start_state, recorder)
        with run.atomic(f"trials/{name}.npz") as path:
            tried.save(path)
        recorder.save(f"recordings/{name}.mcap")

    shards = run.pending([f"recordings/{name}" for name in names], ".mcap")
    run.each(simulate_copies, [Path(shard).name for shard in shards], "demonstrations")
    rows = []
    for name, one in zip(names, shown, strict=True):
        success = Trials.load(run.out / "trials" / f"{name}.npz").success
        rows.append((str(one.task.action), one.source, len(success), int(success.sum())))
    columns = ["action", "source", "trials", "successes"]
    run.save_table("success.csv", pd.DataFrame(rows, columns=columns))


@stage
def demonstrator(
    run: StageRun,
    *,
    simulation: SimulationConfig,
    starts: StartsConfig,
    demonstrator: DemonstratorConfig,
) -> None:
    """The scripted demonstrator's demonstrations, of which the shipped file is a copy.

    Makes scripted.jsonl, recordings/*.mcap, shares.csv (of each demonstration the share of its
    noisy copies that succeed, the room that their ends leave, and the starts given up before) and
    shapes.csv (its rope before, spline and rope after, a row a point in metres).
    """
    wanted = [task for task in TASKS if demonstrator.starts_per_task or not task.start_actions]
    names = [task.name for task in wanted]

    def demonstrate(name: str) -> None:
        number, task = next((i, one) for i, one in enumerate(TASKS) if one.name == name)
        simulator, rng = RopeSimulator(simulation), rng_of(demonstrator.seed, number)
        recorder = Recorder(run, "scripted", simulation.rope)
        found = Demonstrator(task, simulator, rng, demonstrator, starts, recorder).demonstrations()
        recorder.save(f"recordings/{name}.mcap")
        rows = [
            (str(task.action), one.success_rate, one.clearance, left_out)
            for _, one, left_out in found
        ]
        columns = ["action", "share", "room", "starts_left_out"]
        run.save_table(f"{name}.shares.csv", pd.DataFrame(rows, columns=columns), "%.3f")
        shapes = [_shapes(start, one, simulation.rope) for start, one in enumerate(found)]
        run.save_table(f"{name}.shapes.csv", pd.concat(shapes), "%.3f")
        with run.atomic(f"{name}.jsonl") as path:  # the last, by which a task counts as done
            save_demonstrations(path, [one for one, *_ in found])

    run.each(demonstrate, run.pending(names, ".jsonl"), "demonstrations")
    for name in ("shares.csv", "shapes.csv"):
        parts = [pd.read_csv(run.out / f"{task}.{name}", dtype=str) for task in names]
        run.save_table(name, pd.concat(parts))
    with run.atomic("scripted.jsonl") as path:
        paths = [run.out / f"{name}.jsonl" for name in names]
        save_demonstrations(path, [shape for one in paths for shape in load_demonstrations(one)])


def _shapes(start: int, demonstrated: Demonstrated, rope: RopeConfig) -> pd.DataFrame:
    """A demonstration's rope before, spline and rope after, a row a point."""
    shown, found, _ = demonstrated
    controls = control_points(shown.points, shown.spline, rope.radius)
    head = {"action": str(shown.task.action), "start": start}
    facts = head | {"proposal": 0, "outcome": "success"}
    parts = [
        point_rows(shown.points, what="before", proposal="", outcome="", **head),
        point_rows(controls, what="spline", **facts),
        point_rows(found.end, what="after", **facts),
    ]
    return pd.concat(parts)[SHAPE_COLUMNS]


@stage
def evaluation_starts(
    run: StageRun, *, simulation: SimulationConfig, starts: StartsConfig, count: int, seed: int
) -> None:
    """Start shapes of the eight tasks that no method has seen, by scripted guesses.

    Makes <task>.npz with `points` (N, V, 3), recordings/<task>.mcap and starts.csv.

    `count` starts of each task; `seed` is used for nothing else.
    """
    names = [task.name for task in TASKS]

    def reach(name: str) -> None:
        number = names.index(name)
        recorder, rng = Recorder(run, "aim", simulation.rope), rng_of(seed, number)
        simulator, actions = RopeSimulator(simulation), TASKS[number].start_actions
        found = reach_starts(actions, count, simulator, heuristic_splines, rng, starts, recorder)
        recorder.save(f"recordings/{name}.mcap")
        with run.atomic(f"{name}.npz") as path:
            np.savez_compressed(
                path, points=found.points, reached=found.reached, too_tight=found.too_tight
            )

    run.each(reach, run.pending(names, ".npz"), "starts")
    rows = []
    for task in TASKS:
        with np.load(run.out / f"{task.name}.npz") as file:
            rows.append((str(task.action), *(int(file[key]) for key in ("reached", "too_tight"))))
    run.save_table("starts.csv", pd.DataFrame(rows, columns=["action", "reached", "too_tight"]))


def load_starts(folder: Path, name: str) -> NDArray[np.float64]:
    """The ropes (N, V, 3), metres, of a task of `evaluation_starts` or a start state of `pools`."""
    with np.load(folder / f"{name}.npz") as file:
        return np.asarray(file["points"])


@stage
def pools(
    run: StageRun,
    *,
    simulation: SimulationConfig,
    starts: StartsConfig,
    count: int,
    attempts: int = 8000,
    seed: int,
) -> None:
    """Start shapes to train on, by scripted guesses; tasks of one start state share a pool.

    Makes <start state>.npz and recordings/*.mcap.

    `count` starts in each state, or those that `attempts` splines reached; another seed than that
    of the evaluation starts.
    """
    actions = {str(task.start_state): task.start_actions for task in TASKS}

    def fill(name: str) -> None:
        simulator, rng = RopeSimulator(simulation), rng_of(seed, list(actions).index(name))
        recorder = Recorder(run, "aim", simulation.rope)
        found: list[NDArray[np.float64]] = []
        with run.progress(total=count, desc=f"pool of {name}") as bar:
            while len(found) < count and len(recorder) < attempts:
                more = min(POOL_CHUNK, count - len(found))
                some = reach_starts(
                    actions[name], more, simulator, heuristic_splines, rng, starts, recorder
                )
                found.extend(some.points)
                bar.update(more)
        recorder.save(f"recordings/{name}.mcap")
        with run.atomic(f"{name}.npz") as path:
            np.savez_compressed(path, points=np.stack(found))

    run.each(fill, run.pending([*actions], ".npz"), "pools")

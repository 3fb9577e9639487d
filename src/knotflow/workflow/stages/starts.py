"""Stage `starts`: start shapes of the eight tasks, drawn from a seed of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.samplers.demonstrations import TASKS, Task, aim
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, reached
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder


@dataclass(kw_only=True)
class StartsStageConfig:
    """How many starts, and what they look like."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the earlier actions."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a start looks like."""
    count: int
    """Starts of each task."""
    seed: int
    """Starts of equal seed are equal; evaluation and training have different ones."""


@stage("starts", inputs=())
def make_starts(
    config: StartsStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes <task>.npz with `points` (N, V, 3), recordings/<task>.mcap and starts.csv."""
    names = [task.name for task in TASKS]
    context.each(partial(_make, config), context.pending(names, ".npz"), "starts")
    rows = []
    for task in TASKS:
        with np.load(context.out / f"{task.name}.npz") as file:
            rows.append((str(task.action), *(int(file[key]) for key in ("reached", "too_tight"))))
    with context.atomic("starts.csv") as path:
        pd.DataFrame(rows, columns=["action", "reached", "too_tight"]).to_csv(path, index=False)


def _make(config: StartsStageConfig, context: StageContext, name: str) -> None:
    number = [task.name for task in TASKS].index(name)
    rng = np.random.default_rng([config.seed, number])
    recorder = Recorder(context, "aim", config.simulation.rope)
    simulator, actions = RopeSimulator(config.simulation), TASKS[number].start_actions
    starts = reached(actions, config.count, simulator, aim, rng, config.starts, recorder)
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"{name}.npz") as path:
        np.savez_compressed(
            path, points=starts.points, reached=starts.reached, too_tight=starts.too_tight
        )


def load_starts(folder: Path, task: Task) -> np.ndarray:
    """The starts (N, V, 3) of a task from the output of a `starts` stage, metres."""
    with np.load(folder / f"{task.name}.npz") as file:
        return file["points"]

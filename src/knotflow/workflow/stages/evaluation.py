"""Stage `evaluation`: how often a sampler's splines succeed on unseen starts (Sec. VII-A3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.demonstrations import TASKS
from knotflow.recording import write_index
from knotflow.samplers import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, attempt
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder
from knotflow.workflow.stages.starts import load_starts


@dataclass(kw_only=True)
class EvaluationConfig:
    """What is evaluated, and how often it is tried."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the splines."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method; the stages it learns from are inputs of this one."""
    trials_per_start: int
    """Splines sampled for each start."""
    seed: int
    """Of the sampling."""


@stage("evaluation")
def evaluate(config: EvaluationConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes outcomes.csv (action, start, success) and recordings/*.mcap; one shard a task.

    Inputs: `starts`, and whatever the sampler needs.
    """
    names = [task.name for task in TASKS]
    work = partial(_evaluate, config, dict(inputs))
    pending = context.pending([f"outcomes/{name}" for name in names], ".csv")
    context.each(work, [Path(shard).name for shard in pending], "evaluation")
    with context.atomic("outcomes.csv") as path:
        tables = [pd.read_csv(context.out / "outcomes" / f"{name}.csv") for name in names]
        pd.concat(tables).to_csv(path, index=False)
    write_index(context.out / "recordings")


def _evaluate(
    config: EvaluationConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> None:
    simulator = RopeSimulator(config.simulation)
    sampler = build_sampler(config.sampler, inputs)
    number = [task.name for task in TASKS].index(name)
    task = TASKS[number]
    starts = load_starts(inputs["starts"], task)
    rng = np.random.default_rng([config.seed, number])
    first = number * len(starts) * config.trials_per_start
    recorder = Recorder(context, config.sampler.name, config.simulation.rope, first)
    rows = []
    for start, points in enumerate(context.progress(starts, desc=f"evaluation of {task.action}")):
        splines = sampler.sample(points, task.action, config.trials_per_start, rng)
        recorder.extra = {"start": str(start)}
        tried = attempt(simulator, points, splines, task.action, task.start_state, recorder)
        rows += [(str(task.action), start, int(hit)) for hit in tried.success]
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"outcomes/{name}.csv") as path:
        pd.DataFrame(rows, columns=["action", "start", "success"]).to_csv(path, index=False)

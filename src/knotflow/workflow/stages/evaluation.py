"""Stage `evaluation`: how often a sampler's splines succeed on unseen starts (Sec. VII-A3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
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


@dataclass
class EvaluationConfig:
    """What is evaluated, and how often it is tried."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the splines."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method; the stages it learns from are inputs of this one."""
    trials_per_start: int = 8
    """Splines sampled for each start."""
    seed: int = 3
    """Of the sampling."""


@stage("evaluation", version=1)
def evaluate(config: EvaluationConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes outcomes.csv (action, start, success) and recordings/*.mcap; one shard a task.

    Inputs: `starts`, and whatever the sampler needs.
    """
    simulator = RopeSimulator(config.simulation)
    sampler = build_sampler(config.sampler, inputs)
    names = [task.name for task in TASKS]
    starts = {task.name: load_starts(inputs["starts"], task) for task in TASKS}
    trials = {name: len(some) * config.trials_per_start for name, some in starts.items()}
    pending = context.pending([f"outcomes/{name}" for name in names], ".csv")
    done = sum(trials.values()) - sum(trials[Path(name).name] for name in pending)
    with context.progress(total=sum(trials.values()), initial=done, desc="evaluation") as progress:
        for shard in pending:
            name = Path(shard).name
            number = names.index(name)
            task = TASKS[number]
            rng = np.random.default_rng([config.seed, number])
            recorder = Recorder(
                context,
                config.sampler.name,
                config.simulation.rope,
                sum(trials[earlier] for earlier in names[:number]),
            )
            rows = []
            for start, points in enumerate(starts[name]):
                splines = sampler.sample(points, task.action, config.trials_per_start, rng)
                recorder.extra = {"start": str(start)}
                tried = attempt(simulator, points, splines, task.action, task.start_state, recorder)
                rows += [(str(task.action), start, int(hit)) for hit in tried.success]
                progress.update(len(splines))
            recorder.save(f"recordings/{name}.mcap")
            with context.atomic(f"{shard}.csv") as path:
                columns = ["action", "start", "success"]
                pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    with context.atomic("outcomes.csv") as path:
        tables = [pd.read_csv(context.out / "outcomes" / f"{name}.csv") for name in names]
        pd.concat(tables).to_csv(path, index=False)
    write_index(context.out / "recordings")

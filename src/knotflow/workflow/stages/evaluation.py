"""Stage `evaluation`: how often a sampler's splines succeed on unseen starts (Sec. VII-A3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.planning import attempt_arranged
from knotflow.recording import write_index
from knotflow.samplers.demonstrations import TASKS, Task
from knotflow.samplers.sampler import Sampler, SamplerConfig, build_sampler
from knotflow.simulation import Observer, RopeSimulator, SimulationConfig, attempt
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
    arranging: int = 0
    """Most splines of a trial that arrange the rope before the one that acts; 0 is the paper."""
    seed: int
    """Of the sampling."""


@stage("evaluation")
def evaluate(config: EvaluationConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes outcomes.csv (action, start, success) and recordings/*.mcap; one shard a task.

    Inputs: `starts`, and whatever the sampler needs.
    """
    names = [task.name for task in TASKS]
    work = partial(_evaluate, config, dict(inputs))
    context.table("outcomes.csv", work, names, "evaluation")
    write_index(context.out / "recordings")


def _evaluate(
    config: EvaluationConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> pd.DataFrame:
    simulator = RopeSimulator(config.simulation)
    sampler = build_sampler(config.sampler, inputs)
    number = [task.name for task in TASKS].index(name)
    task = TASKS[number]
    starts = load_starts(inputs["starts"], task)
    rng = np.random.default_rng([config.seed, number])
    each = config.trials_per_start * (1 + config.arranging)
    first = number * len(starts) * each
    recorder = Recorder(context, config.sampler.name, config.simulation.rope, first)
    rows = []
    for start, points in enumerate(context.progress(starts, desc=f"evaluation of {task.action}")):
        recorder.extra = {"start": str(start)}
        success = _tried(points, task, config, sampler, simulator, rng, recorder)
        rows += [(str(task.action), start, int(hit)) for hit in success]
    recorder.save(f"recordings/{name}.mcap")
    return pd.DataFrame(rows, columns=["action", "start", "success"])


def _tried(
    points: NDArray,
    task: Task,
    config: EvaluationConfig,
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    observe: Observer,
) -> NDArray[np.bool_]:
    """The outcomes (trials,) of one start."""
    count, most = config.trials_per_start, config.arranging
    if not most:
        splines = sampler.sample(points, task.action, count, rng)
        return attempt(simulator, points, splines, task.action, task.start_state, observe).success
    ropes = np.repeat(points[None], count, axis=0)
    state = task.start_state
    return attempt_arranged(
        ropes, task.action, state, sampler, simulator, rng, most, observe
    ).success

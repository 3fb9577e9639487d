"""Stage `demonstrator`: the scripted demonstrator's 50 demonstrations, from which the shipped
file is a copy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.demonstrations import (
    TASKS,
    Demonstration,
    DemonstratorConfig,
    Task,
    aim,
    demonstrate,
    load_demonstrations,
    save_demonstrations,
)
from knotflow.simulation import (
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    reached,
    straight,
)
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder


@dataclass
class DemonstratorStageConfig:
    """How the demonstrations are made."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator the demonstrator searches in."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a start shape looks like."""
    demonstrator: DemonstratorConfig = field(default_factory=DemonstratorConfig)
    """The effort spent on each."""
    starts_per_task: int = 8
    """Start shapes of each task that begins tangled; an untangled one begins straight, once."""
    least_share: float = 0.4
    """Share of its noisy copies that must succeed; a start that gets none so good is replaced."""
    seed: int = 1
    """Of everything random."""


@stage("demonstrator", version=1, inputs=())
def make_demonstrations(
    config: DemonstratorStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes scripted.jsonl, shares.csv (of noisy copies that succeed) and recordings/*.mcap."""
    wanted = _wanted(config)
    context.each(partial(_make, config), context.pending([*wanted], ".jsonl"), "demonstrations")
    with context.atomic("shares.csv") as path:
        shares = pd.concat([pd.read_csv(context.out / f"{name}.csv") for name in wanted])
        shares.to_csv(path, index=False)
    with context.atomic("scripted.jsonl") as path:
        demonstrations = [
            demonstration
            for name in wanted
            for demonstration in load_demonstrations(context.out / f"{name}.jsonl")
        ]
        save_demonstrations(path, demonstrations)


def _wanted(config: DemonstratorStageConfig) -> dict[str, tuple[Task, list[int]]]:
    """Each demonstration's name, task and seed."""
    return {
        f"{task.name}-{i}": (task, [config.seed, number, i])
        for number, task in enumerate(TASKS)
        for i in range(config.starts_per_task if task.start_actions else 1)
    }


def _make(config: DemonstratorStageConfig, context: StageContext, name: str) -> None:
    task, seed = _wanted(config)[name]
    simulator, rng = RopeSimulator(config.simulation), np.random.default_rng(seed)
    recorder = Recorder(context, "scripted", config.simulation.rope)
    found, share, left_out = _one(task, rng, simulator, config, recorder)
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"{name}.csv") as path:
        row = {"action": str(task.action), "success_share": share, "starts_left_out": left_out}
        pd.DataFrame([row]).to_csv(path, index=False)
    with context.atomic(f"{name}.jsonl") as path:
        save_demonstrations(path, [found])


def _one(
    task: Task,
    rng: np.random.Generator,
    simulator: RopeSimulator,
    config: DemonstratorStageConfig,
    recorder: Recorder,
) -> tuple[Demonstration, float, int]:
    """A demonstration, the share of its noisy copies that succeed, and starts given up before."""
    for left_out in range(20):
        if task.start_actions:
            starts = reached(task.start_actions, 1, simulator, aim, rng, config.starts, recorder)
            points = starts.points[0]
        else:
            points = straight(config.simulation.rope)
        result = demonstrate(points, task, simulator, rng, config.demonstrator, recorder)
        if result is not None and result[1] >= config.least_share:
            return Demonstration(task, points, result[0], "scripted"), result[1], left_out
    raise RuntimeError(
        f"no spline for {task.action} had {config.least_share:.0%} of its noisy copies succeed on "
        "any of 20 starts; lower least_share or raise the demonstrator's effort"
    )

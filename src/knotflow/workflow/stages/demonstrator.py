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

from knotflow.demonstrations import DemonstratorConfig, load_demonstrations, save_demonstrations
from knotflow.demonstrations.demonstrator import demonstrate_from_any_start, wanted
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig
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
    """How many there are, and the effort spent on each."""


@stage("demonstrator", inputs=())
def make_demonstrations(
    config: DemonstratorStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes scripted.jsonl, shares.csv (of noisy copies that succeed) and recordings/*.mcap."""
    names = list(wanted(config.demonstrator))
    context.each(partial(_make, config), context.pending(names, ".jsonl"), "demonstrations")
    with context.atomic("shares.csv") as path:
        shares = pd.concat([pd.read_csv(context.out / f"{name}.csv") for name in names])
        shares.to_csv(path, index=False)
    with context.atomic("scripted.jsonl") as path:
        parts = [load_demonstrations(context.out / f"{name}.jsonl") for name in names]
        save_demonstrations(path, sum(parts, []))


def _make(config: DemonstratorStageConfig, context: StageContext, name: str) -> None:
    task, seed = wanted(config.demonstrator)[name]
    simulator, rng = RopeSimulator(config.simulation), np.random.default_rng(seed)
    recorder = Recorder(context, "scripted", config.simulation.rope)
    found = demonstrate_from_any_start(
        task, simulator, rng, config.demonstrator, config.starts, recorder
    )
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"{name}.csv") as path:
        row = {
            "action": str(task.action),
            "success_share": found.share,
            "starts_left_out": found.starts_left_out,
        }
        pd.DataFrame([row]).to_csv(path, index=False)
    with context.atomic(f"{name}.jsonl") as path:
        save_demonstrations(path, [found.demonstration])

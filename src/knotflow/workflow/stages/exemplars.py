"""Stage `exemplars`: a few rollouts of an evaluation again, each a recording to look at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from knotflow.recording import load, recorded, write_recording
from knotflow.samplers.demonstrations import TASKS
from knotflow.simulation import RopeSimulator, SimulationConfig, attempt
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.starts import load_starts


@dataclass
class ExemplarsConfig:
    """Which rollouts are shown, and how finely."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator of the evaluation."""
    record_rate: float = 50.0
    """Frames per second."""


@stage("exemplars", inputs=("starts", "evaluation"))
def show(config: ExemplarsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes recordings/<task>.mcap with the first success of each task, else its first rollout."""
    simulation = replace(config.simulation, record_rate=config.record_rate)
    simulator = RopeSimulator(simulation)
    rollouts = load(inputs["evaluation"] / "recordings")
    for task in TASKS:
        of_task = rollouts[rollouts["action"] == str(task.action)]
        best = of_task.assign(hit=of_task["outcome"] == "success").sort_values(
            ["hit", "number"], ascending=[False, True]
        )
        row = best.iloc[0]
        spline = row[[name for name in row.index if name.startswith("spline_")]]
        points = load_starts(inputs["starts"], task)[int(row["extra"]["start"])]
        tried = attempt(
            simulator, points, np.array([spline], dtype=float), task.action, task.start_state
        )
        with context.atomic(f"recordings/{task.name}.mcap") as path:
            facts = {"evaluation": context.inputs_signatures["evaluation"]}
            write_recording(
                path, recorded(tried, simulation.rope, row["source"], context.signature), facts
            )

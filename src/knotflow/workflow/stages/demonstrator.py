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

from knotflow.samplers.demonstrations import (
    TASKS,
    DemonstratorConfig,
    Task,
    load_demonstrations,
    save_demonstrations,
)
from knotflow.samplers.demonstrations.demonstrator import Demonstrated, demonstrate_task
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    control_points,
)
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.proposals import AFTER, BEFORE, COLUMNS, SPLINE, point_rows
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


SHAPES = "shapes.csv"


@stage("demonstrator", inputs=(), version=2)
def make_demonstrations(
    config: DemonstratorStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes scripted.jsonl, shares.csv, shapes.csv and recordings/*.mcap.

    shares.csv has a row a demonstration: the share of its noisy copies that succeed, the room that
    their ends leave (`demonstrations.room`), and the starts that were given up before. shapes.csv
    shows them, in the columns of the stage `proposals`.
    """
    tasks = [task.name for task in TASKS if _wanted(config.demonstrator, task)]
    context.each(partial(_make, config), context.pending(tasks, ".jsonl"), "demonstrations")
    for name in ("shares.csv", SHAPES):
        with context.atomic(name) as path:
            parts = [pd.read_csv(context.out / f"{task}.{name}", dtype=str) for task in tasks]
            pd.concat(parts).to_csv(path, index=False)
    with context.atomic("scripted.jsonl") as path:
        shown = [load_demonstrations(context.out / f"{task}.jsonl") for task in tasks]
        save_demonstrations(path, sum(shown, []))


def _wanted(config: DemonstratorConfig, task: Task) -> bool:
    return config.starts_per_task > 0 or not task.start_actions


def _make(config: DemonstratorStageConfig, context: StageContext, name: str) -> None:
    number, task = next((i, one) for i, one in enumerate(TASKS) if one.name == name)
    simulator = RopeSimulator(config.simulation)
    rng = np.random.default_rng([config.demonstrator.seed, number])
    recorder = Recorder(context, "scripted", config.simulation.rope)
    found = demonstrate_task(task, simulator, rng, config.demonstrator, config.starts, recorder)
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"{name}.shares.csv") as path:
        rows = [
            {
                "action": str(task.action),
                "share": one.scored.share,
                "room": one.scored.room,
                "starts_left_out": one.starts_left_out,
            }
            for one in found
        ]
        pd.DataFrame(rows).to_csv(path, index=False, float_format="%.3f")
    with context.atomic(f"{name}.{SHAPES}") as path:
        shapes = [_shapes(start, one, config.simulation.rope) for start, one in enumerate(found)]
        pd.concat(shapes).to_csv(path, index=False, float_format="%.3f")
    with context.atomic(f"{name}.jsonl") as path:  # the last, by which a task counts as done
        save_demonstrations(path, [one.demonstration for one in found])


def _shapes(start: int, one: Demonstrated, rope: RopeConfig) -> pd.DataFrame:
    """A demonstration's rope before, spline and rope after, a row a point."""
    shown = one.demonstration
    controls = control_points(shown.points, shown.spline, rope.radius)
    head = {"action": str(shown.task.action), "start": start}
    facts = head | {"proposal": 0, "outcome": "success"}
    parts = [
        point_rows(shown.points, what=BEFORE, proposal="", outcome="", **head),
        point_rows(controls, what=SPLINE, **facts),
        point_rows(one.scored.end, what=AFTER, **facts),
    ]
    return pd.concat(parts)[list(COLUMNS)]

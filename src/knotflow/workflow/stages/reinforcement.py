"""Stage `reinforcement`: primitives go on learning from their own attempts (Sec. V-B b)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.recording import write_index
from knotflow.samplers.demonstrations import load_trials
from knotflow.samplers.primitives import FILE, PRIMITIVES, PrimitiveLibrary
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig
from knotflow.training import Reinforcement, ReinforcementConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.curves import Curves
from knotflow.workflow.stages.imitation import merge, number_of, tasks_of
from knotflow.workflow.stages.recorder import Recorder


@dataclass(kw_only=True)
class ReinforcementStageConfig:
    """How long, and on what rope."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the attempts."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a start looks like."""
    reinforcement: ReinforcementConfig = field(default_factory=ReinforcementConfig)
    """The effort."""
    seed: int
    """Of everything random."""


@stage("reinforcement", inputs=("demonstrations", "imitation", "pools"))
def reinforce(
    config: ReinforcementStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes primitives.safetensors, curves.csv and recordings/*.mcap, one a primitive and round.

    A round that was interrupted is simulated again, to the same rollouts, and replaces its file.
    """
    parts = [f"primitive-{number}" for number in PRIMITIVES]
    work = partial(_reinforce, config, dict(inputs))
    context.each(work, context.pending(parts, ".safetensors"), "reinforcement")
    merge(context, parts)
    write_index(context.out / "recordings")


def _reinforce(
    config: ReinforcementStageConfig, inputs: Mapping[str, Path], context: StageContext, part: str
) -> None:
    number = number_of(part)
    tasks = tasks_of(number)
    trials = load_trials(inputs["demonstrations"])
    rope = config.simulation.rope
    training = Reinforcement(
        PrimitiveLibrary.load(inputs["imitation"] / FILE, rope).primitives[number],
        [trials[task.action] for task in tasks],
        {task: _pool(inputs["pools"], str(task.start_state)) for task in tasks},
        RopeSimulator(config.simulation),
        config.reinforcement,
        config.seed + number,
        config.starts,
    )
    curves = Curves(context, part)
    if checkpoint := curves.checkpoint():
        training.load(checkpoint)
    bar = context.progress(
        total=config.reinforcement.rounds, initial=len(curves), desc=f"reinforcement {number}"
    )
    with bar:
        for one in training:
            curves.add(number, one.metrics)
            each = sum(len(attempts) for attempts in one.attempts)
            first = number * 1_000_000 + one.index * each
            recorder = Recorder(context, "reinforcement", rope, first)
            for attempts in one.attempts:
                recorder(attempts)
            recorder.save(f"recordings/{part}-{one.index:03d}.mcap")
            bar.update()
            if len(curves) % 4 == 0:
                with curves.saving() as folder:
                    training.save(folder)
    curves.save()
    actions = [task.action for task in tasks]
    with context.atomic(f"{part}.safetensors") as path:
        PrimitiveLibrary({number: training.primitive}, {number: actions}, rope).save(path)


def _pool(folder: Path, state: str) -> np.ndarray:
    """The starts (N, V, 3) in a state from the output of a `pools` stage, metres."""
    with np.load(folder / f"{state}.npz") as file:
        return file["points"]

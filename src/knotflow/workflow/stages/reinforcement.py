"""Stage `reinforcement`: primitives go on learning from their own attempts (Sec. V-B b)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.recording import write_index
from knotflow.samplers.demonstrations import load_trials
from knotflow.samplers.primitives import FILE, PRIMITIVES, PrimitiveLibrary
from knotflow.simulation import Attempts, RopeSimulator, SimulationConfig, StartsConfig
from knotflow.training import Reinforcement, ReinforcementConfig
from knotflow.training.trainer import run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.imitation import log_to, merge, number_of, tasks_of
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

    def record(index: int, attempts: Sequence[Attempts]) -> None:
        first = number * 1_000_000 + index * sum(map(len, attempts))
        recorder = Recorder(context, "reinforcement", rope, first)
        for some in attempts:
            recorder(some)
        recorder.save(f"recordings/{part}-{index:03d}.mcap")

    training = Reinforcement(
        PrimitiveLibrary.load(inputs["imitation"] / FILE, rope).primitives[number],
        [one for task in tasks for one in trials[task.action]],
        {task: _pool(inputs["pools"], str(task.start_state)) for task in tasks},
        RopeSimulator(config.simulation),
        config.reinforcement,
        config.seed + number,
        config.starts,
        record,
    )

    def finish() -> None:
        actions = [task.action for task in tasks]
        with context.atomic(f"{part}.safetensors") as path:
            PrimitiveLibrary({number: training.primitive}, {number: actions}, rope).save(path)

    run_training(
        training, context.out / part, name=f"reinforcement {number}", progress=context.progress,
        save_every=4, finish=finish, log=log_to(context, number),
    )  # fmt: skip


def _pool(folder: Path, state: str) -> np.ndarray:
    """The starts (N, V, 3) in a state from the output of a `pools` stage, metres."""
    with np.load(folder / f"{state}.npz") as file:
        return file["points"]

"""Stage `demonstrations`: noisy copies of every demonstration, simulated (Sec. V-B a, VII-A1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.recording import write_index
from knotflow.samplers.demonstrations import (
    SHIPPED,
    Demonstration,
    NoiseConfig,
    load_demonstrations,
    noisy_copies,
)
from knotflow.simulation import RopeSimulator, SimulationConfig, Trials, attempt, resample
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder


@dataclass(kw_only=True)
class DemonstrationsConfig:
    """How many noisy copies of which demonstrations."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that decides which copies succeed."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """The noise that is added."""
    copies: int
    """Copies of a demonstration from a tangled start."""
    copies_untangled: int
    """Copies of a demonstration from an untangled start."""
    seed: int
    """Of the noise."""
    file: str = runtime(str(SHIPPED))
    """Demonstrations to copy (JSON lines); what counts is what is in it, see `digest`."""
    digest: str = ""
    """Hash of the file's contents, so that other demonstrations are another stage."""


@stage("demonstrations", inputs=())
def simulate_demonstrations(
    config: DemonstrationsConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes recordings/*.mcap with index.parquet, trials/*.npz and success.csv.

    One shard a demonstration; a shard is complete when its recording is there.
    """
    demonstrations = _named(config)
    shards = context.pending([f"recordings/{name}" for name in demonstrations], ".mcap")
    work = partial(_simulate, config)
    context.each(work, [Path(shard).name for shard in shards], "demonstrations")
    rows = []
    for name, one in demonstrations.items():
        success = Trials.load(context.out / "trials" / f"{name}.npz").success
        rows.append((str(one.task.action), one.source, len(success), int(success.sum())))
    with context.atomic("success.csv") as path:
        columns = ["action", "source", "trials", "successes"]
        pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    write_index(context.out / "recordings")


def _simulate(config: DemonstrationsConfig, context: StageContext, name: str) -> None:
    demonstrations = _named(config)
    number, one = list(demonstrations).index(name), demonstrations[name]
    rng = np.random.default_rng([config.seed, number])
    splines = noisy_copies(one.spline, _copies(one, config), rng, config.noise)
    points = resample(one.points, config.simulation.rope)
    first = sum(_copies(other, config) for other in list(demonstrations.values())[:number])
    recorder = Recorder(context, one.source, config.simulation.rope, first)
    recorder.extra = {"start": str(number)}
    simulator = RopeSimulator(config.simulation)
    tried = attempt(simulator, points, splines, one.task.action, one.task.start_state, recorder)
    with context.atomic(f"trials/{name}.npz") as path:
        tried.save(path)
    recorder.save(f"recordings/{name}.mcap")


def _named(config: DemonstrationsConfig) -> dict[str, Demonstration]:
    demonstrations = load_demonstrations(Path(config.file))
    return {f"{number:03d}-{one.task.name}": one for number, one in enumerate(demonstrations)}


def _copies(one: Demonstration, config: DemonstrationsConfig) -> int:
    return config.copies if one.task.start_actions else config.copies_untangled

"""Stage `scaling`: the same shards on one worker, on two, and on two of a Ray cluster."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.simulation import (
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    random_trials,
)
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.workers import WorkersConfig

SPLINES = 32
"""Of a shard."""


@dataclass(kw_only=True)
class ScalingConfig:
    """What is timed."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator; each worker has one thread."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """The random curves that splines start from."""
    rollouts: int
    """Random splines in each case, in shards of 32."""
    backends: list[str]
    """Two workers of each are timed, beside one; Ray is left out where it is not installed."""
    seed: int = 4
    """Of starts and splines."""
    run: int
    """Raise it to time again: a finished stage is never run twice."""


@stage("scaling", inputs=())
def time_workers(config: ScalingConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes scaling.csv, a row a case; starting the workers is not timed."""
    rows, shards = [], max(1, config.rollouts // SPLINES)
    for backend, workers in [("loky", 1), *((one, 2) for one in config.backends)]:
        if backend == "ray" and find_spec("ray") is None:
            continue
        here = replace(context, workers=WorkersConfig(backend, workers))
        name = f"{workers} of {backend}"
        here.each(partial(_simulate, config), [-1] * workers, f"{name}, starting")
        began = time.perf_counter()
        here.each(partial(_simulate, config), range(shards), name)
        seconds = time.perf_counter() - began
        rows.append(
            {
                "backend": backend,
                "workers": workers,
                "shards": shards,
                "seconds": round(seconds, 3),
                "splines_per_second": round(shards * SPLINES / seconds, 2),
            }
        )
    with context.atomic("scaling.csv") as path:
        pd.DataFrame(rows).to_csv(path, index=False)


def _simulate(config: ScalingConfig, context: StageContext, shard: int) -> None:
    """One shard, which leaves nothing; a negative one is a single spline."""
    rng = np.random.default_rng([config.seed, abs(shard)])
    count = SPLINES if shard >= 0 else 1
    simulator = RopeSimulator(replace(config.simulation, threads=1))
    simulator.execute(*random_trials(config.simulation.rope, count, rng, config.starts))

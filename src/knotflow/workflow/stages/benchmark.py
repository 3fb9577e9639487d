"""Stage `benchmark`: splines per second, and memory; figures for the README, not a test."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.simulation import (
    ROOTS,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    random_trials,
)
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage


@dataclass(kw_only=True)
class BenchmarkConfig:
    """What is timed."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """The random curves that splines start from."""
    rollouts: int
    """Random splines in each case."""
    seed: int = 4
    """Of starts and splines."""
    links: list[int] = field(default_factory=lambda: [32, 40])
    """Ropes to compare, by their number of links."""
    run: int
    """Raise it to time again: a finished stage is never run twice."""


@stage("benchmark", inputs=())
def time_simulation(
    config: BenchmarkConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes throughput.csv."""
    cpus = os.cpu_count() or 1
    cases = [(links, threads) for links in config.links for threads in sorted({1, cpus})]
    rows = []
    for links, threads in context.progress(cases, desc="benchmark"):
        for root, (wall, cpu) in _seconds(config, links, threads).items():
            rows.append(
                {
                    "case": "random splines on random curves",
                    "root": root,
                    "links": links,
                    "threads": threads,
                    "rollouts": config.rollouts,
                    "seconds": round(wall, 3),
                    "cpu_seconds": round(cpu, 3),
                    "splines_per_second": round(config.rollouts / wall, 2),
                    "peak_memory_mb": round(
                        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1
                    ),
                }
            )
    with context.atomic("throughput.csv") as path:
        pd.DataFrame(rows).to_csv(path, index=False)


def _seconds(config: BenchmarkConfig, links: int, threads: int) -> dict[str, tuple[float, float]]:
    """Wall and CPU seconds of the same splines by root; roots take turns, so that both are slowed
    alike by whatever else the machine does.
    """
    ropes = {root: replace(config.simulation.rope, links=links, root=root) for root in ROOTS}
    simulators = {
        root: RopeSimulator(replace(config.simulation, rope=rope, threads=threads))
        for root, rope in ropes.items()
    }
    rng, count = np.random.default_rng(config.seed), config.rollouts
    points, splines = random_trials(ropes["head"], count, rng, config.starts)
    seconds = dict.fromkeys(ROOTS, np.zeros(2))
    for simulator in simulators.values():
        simulator.execute(points[:64], splines[:64])  # threads and caches are warm
    for rows in np.array_split(np.arange(count), max(1, count // 64)):
        for root, simulator in simulators.items():
            begin = np.array([time.perf_counter(), time.process_time()])
            simulator.execute(points[rows], splines[rows])
            now = np.array([time.perf_counter(), time.process_time()])
            seconds[root] = seconds[root] + now - begin
    return {root: (float(wall), float(cpu)) for root, (wall, cpu) in seconds.items()}

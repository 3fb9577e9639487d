"""Splines simulated per second, and the time of perception's gradient steps."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np
import pandas as pd

from knotflow.perception import SAMPLE, FitConfig, fit, observe, read_capture
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    random_trials,
    resample,
)
from knotflow.workflow import StageRun, stage


@stage
def throughput(
    run: StageRun,
    *,
    simulation: SimulationConfig,
    starts: StartsConfig,
    rollouts: int,
    seed: int = 4,
    links: list[int] = [32, 40],
    repeat: int,
) -> None:
    """Random splines on random curves. Makes throughput.csv, a row a number of links and threads.

    Raise `repeat` to time again: a finished stage is never run twice.
    """
    cpus = os.cpu_count() or 1
    cases = [(number, threads) for number in links for threads in sorted({1, cpus})]
    rows = []
    for number, threads in run.progress(cases, desc="throughput"):
        rope = replace(simulation.rope, links=number)
        simulator = RopeSimulator(replace(simulation, rope=rope, threads=threads))
        points, splines = random_trials(rope, rollouts, np.random.default_rng(seed), starts)
        simulator.execute(points[:64], splines[:64])  # threads and caches are warm
        wall, cpu = time.perf_counter(), time.process_time()
        for batch in np.array_split(np.arange(rollouts), max(1, rollouts // 64)):
            simulator.execute(points[batch], splines[batch])
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        rows.append(
            {
                "case": "random splines on random curves",
                "links": number,
                "threads": threads,
                "rollouts": rollouts,
                "seconds": round(wall, 3),
                "cpu_seconds": round(cpu, 3),
                "splines_per_second": round(rollouts / wall, 2),
            }
        )
    run.save_table("throughput.csv", pd.DataFrame(rows))


@stage
def gradient_steps(run: StageRun, *, rope: RopeConfig, steps: int = 80, repeat: int) -> None:
    """CPU milliseconds of a step that fits a rope's shape to the shipped overhand's image.

    Makes gradient_steps.csv by the pixels along each side of one of the grid of a step.
    """
    colour, depth = SAMPLE / "overhand.png", SAMPLE / "overhand-depth.png"
    seen = read_capture(colour, depth, SAMPLE / "camera.yaml")
    points = resample(np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1), rope)
    target, once = observe(seen.image, seen.camera, rope), FitConfig(steps=1)
    rows = []
    for grid in (1, 2):
        coarse = target.binned(grid)
        fit(points, coarse, once)  # caches are warm
        began = time.process_time()
        fit(points, coarse, replace(once, steps=steps))
        seconds = time.process_time() - began
        rows.append({"grid": grid, "milliseconds": round(1e3 * seconds / steps, 2)})
    run.save_table("gradient_steps.csv", pd.DataFrame(rows))

"""Stage `pools`: start shapes to train on, reached by a sampler's own splines.

Reinforcement needs many more starts than demonstrations have. They are made the way a plan makes
them, with the primitives as they are after imitation, and shared by everything that trains.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from knotflow.demonstrations import TASKS
from knotflow.samplers import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, reached
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder


@dataclass
class PoolsConfig:
    """How many starts, and how they are reached."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the earlier actions."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a start looks like."""
    sampler: SamplerConfig = field(default_factory=lambda: SamplerConfig("primitives"))
    """Proposes the earlier actions' splines."""
    count: int = 192
    """Starts of each task."""
    seed: int = 11
    """Of everything random; not that of the evaluation starts."""


@stage("pools", version=1)
def make_pools(config: PoolsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes <start>.npz for every start state of the tasks, and recordings/*.mcap.

    Tasks with the same start state share a pool.
    """
    simulator = RopeSimulator(config.simulation)
    sampler = build_sampler(config.sampler, inputs)
    pools = {str(task.start_state): task.start_actions for task in TASKS}
    names = list(pools)
    for name in context.progress(context.pending(names, ".npz"), desc="pools"):
        rng = np.random.default_rng([config.seed, names.index(name)])
        recorder = Recorder(context, config.sampler.name, config.simulation.rope)
        starts = reached(
            pools[name], config.count, simulator, sampler.sample, rng, config.starts, recorder
        )
        recorder.save(f"recordings/{name}.mcap")
        with context.atomic(f"{name}.npz") as path:
            np.savez_compressed(path, points=starts.points)

"""Stage `pools`: start shapes to train on, reached by a sampler's own splines.

Reinforcement needs many more starts than demonstrations have. They are made as the evaluation's
are, by scripted guesses on random curves, but from another seed, and are shared by everything that
trains.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.samplers.demonstrations import TASKS
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, reached
from knotflow.topology import Action
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder

CHUNK = 32
"""Starts that are made at a time."""


@dataclass(kw_only=True)
class PoolsConfig:
    """How many starts, and how they are reached."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the earlier actions."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a start looks like."""
    sampler: SamplerConfig = field(default_factory=lambda: SamplerConfig("aimed"))
    """Proposes the earlier actions' splines."""
    count: int
    """Starts in each state."""
    attempts: int = 8000
    """Splines after which a state has the starts that were reached by then: some states are hard
    to reach by guesses."""
    seed: int = 11
    """Of everything random; not that of the evaluation starts."""


@stage("pools")
def make_pools(config: PoolsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes <start>.npz for every start state of the tasks, and recordings/*.mcap.

    Tasks with the same start state share a pool.
    """
    names = list(_actions())
    work = partial(_make, config, dict(inputs))
    context.each(work, context.pending(names, ".npz"), "pools")


def _make(
    config: PoolsConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> None:
    simulator = RopeSimulator(config.simulation)
    sampler = build_sampler(config.sampler, inputs)
    actions = _actions()
    rng = np.random.default_rng([config.seed, list(actions).index(name)])
    recorder = Recorder(context, config.sampler.name, config.simulation.rope)
    found: list[np.ndarray] = []
    with context.progress(total=config.count, desc=f"pool of {name}") as bar:
        while len(found) < config.count and len(recorder) < config.attempts:
            count = min(CHUNK, config.count - len(found))
            found.extend(
                reached(
                    actions[name], count, simulator, sampler.sample, rng, config.starts, recorder
                ).points
            )
            bar.update(count)
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"{name}.npz") as path:
        np.savez_compressed(path, points=np.stack(found))


def _actions() -> dict[str, tuple[Action, ...]]:
    """The actions that reach each start state of the tasks."""
    return {str(task.start_state): task.start_actions for task in TASKS}

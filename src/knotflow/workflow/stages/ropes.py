"""Stage `ropes`: rope shapes such as plans meet, for perception to learn from.

Random curves are moved by spline after spline, aimed at an action or random, and every shape that
a spline leaves behind is kept. So tangled ropes are met as a plan meets them, failures included.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.samplers.demonstrations import aim_anywhere
from knotflow.simulation import (
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    random_curve,
    state_or_none,
)
from knotflow.topology import TopologicalState
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage

FILE = "ropes.npz"
TOGETHER = 32
"""Ropes of a shard."""


@dataclass(kw_only=True)
class RopesConfig:
    """How many shapes, and how they come about."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the splines."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """The random curves that are moved."""
    shards: int
    """Shards of 32 ropes."""
    rounds: int
    """Splines that a rope is moved by, one after the other."""
    random_share: float = 0.25
    """Share of the splines that are random, not aimed at an action."""
    most_crossings: int = 5
    """A rope with more crossings is left out."""
    seed: int
    """Of everything random."""


@stage("ropes", inputs=(), version=2)
def make_ropes(config: RopesConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes ropes.npz: `points` (N, V, 3) float32, metres, and their number of `crossings` (N,)."""
    shards = [f"shard-{number:04d}" for number in range(config.shards)]
    work = partial(_move, config)
    context.each(work, context.pending(shards, ".npz"), "ropes")
    parts = [np.load(context.out / f"{shard}.npz") for shard in shards]
    points, crossings = (
        np.concatenate([part[name] for part in parts]) for name in ("points", "crossings")
    )
    with context.atomic(FILE) as path:
        np.savez(path, points=points, crossings=crossings)
    for shard in shards:
        (context.out / f"{shard}.npz").unlink()


def _move(config: RopesConfig, context: StageContext, shard: str) -> None:
    rng = np.random.default_rng([config.seed, int(shard.rpartition("-")[2])])
    simulator = RopeSimulator(config.simulation)
    rope = config.simulation.rope
    ropes = np.stack([random_curve(rope, rng, config.starts) for _ in range(TOGETHER)])
    states = [TopologicalState.trivial()] * TOGETHER
    points, crossings = [*ropes.copy()], [0] * TOGETHER
    for _ in range(config.rounds):
        splines = np.stack(
            [
                aim_anywhere(one, state, rng, config.random_share, config.most_crossings)
                for one, state in zip(ropes, states, strict=True)
            ]
        )
        rollouts = simulator.execute(ropes, splines)
        for index, (end, diverged) in enumerate(
            zip(rollouts.end_points, rollouts.diverged, strict=True)
        ):
            state = None if diverged else state_or_none(end)
            if state is None or state.num_crossings > config.most_crossings:
                continue
            middle = 0.5 * (end[:, :2].max(0) + end[:, :2].min(0))
            ropes[index], states[index] = end - [*middle, 0.0], state
            points.append(ropes[index].copy())
            crossings.append(state.num_crossings)
    with context.atomic(f"{shard}.npz") as path:
        np.savez(path, points=np.stack(points).astype(np.float32), crossings=np.array(crossings))

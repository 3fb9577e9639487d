"""Stage `motions`: perturbed ropes dragged by a gripper and let go (Sec. VI).

Dynamics are learned from such motions, and judged by others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.execution import Motions, draw_motions
from knotflow.samplers.demonstrations import SHIPPED, load_demonstrations
from knotflow.simulation import LEVELS, SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage

FILE = "motions.npz"


@dataclass(kw_only=True)
class MotionsConfig:
    """Which ropes, and how they are moved."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The planner's simulator, around whose rope the others are drawn."""
    demonstrations: str = runtime(str(SHIPPED))
    """From whose starts and splines motions are made; what counts is `digest`."""
    digest: str
    """Of that file."""
    ropes: int
    """Perturbed ropes, levels in turn."""
    per_rope: int
    """Motions of each."""
    seed: int
    """Of ropes and motions; used for nothing else."""


@stage("motions", inputs=())
def make_motions(config: MotionsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes motions.npz, see `execution.Motions`; one shard a rope."""
    shards = [f"shard-{number:04d}.npz" for number in range(config.ropes)]
    context.each(partial(_draw, config), context.pending(shards), "ropes")
    motions = Motions.join([Motions.load(context.out / shard) for shard in shards])
    with context.atomic(FILE) as path:
        motions.save(path)
    for shard in shards:
        (context.out / shard).unlink()


def _draw(config: MotionsConfig, context: StageContext, shard: str) -> None:
    number = int(Path(shard).stem.rpartition("-")[2])
    rng = np.random.default_rng([config.seed, number])
    demonstrations = load_demonstrations(Path(config.demonstrations))
    levels = (LEVELS[number % len(LEVELS)],)
    motions = Motions.join(
        list(draw_motions(demonstrations, config.simulation, 1, config.per_rope, rng, levels))
    )
    with context.atomic(shard) as path:
        motions.save(path)

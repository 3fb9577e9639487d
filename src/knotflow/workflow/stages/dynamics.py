"""Stage `dynamics`: how far models of a rope are off on ropes they have not seen (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from knotflow.demonstrations import SHIPPED, load_demonstrations
from knotflow.execution import (
    LstmDynamics,
    Motions,
    MujocoDynamics,
    RopeDynamics,
    Still,
    draw_motions,
    prediction_errors,
)
from knotflow.simulation import LEVELS, SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage


@dataclass(kw_only=True)
class DynamicsConfig:
    """What is predicted, and by which weights."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The planner's simulator: a model itself, and around its rope the others are drawn."""
    demonstrations: str = runtime(str(SHIPPED))
    """From whose starts and splines motions are made; what counts is `digest`."""
    digest: str
    """Of that file."""
    weights: str = runtime("")
    """File of the learned dynamics; what counts is `weights_contents`."""
    weights_contents: str
    """Digest of what the file holds."""
    ropes: int
    """Perturbed ropes, levels in turn."""
    per_rope: int
    """Motions of each."""
    seed: int
    """Of ropes and motions; used for nothing else."""


@stage("dynamics", inputs=())
def measure(config: DynamicsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes errors.csv, a row a model, level and number of steps; one shard a rope."""
    names = [f"motions/{number:03d}.npz" for number in range(config.ropes)]
    context.each(partial(_draw, config), context.pending(names), "ropes")
    motions = Motions.join([Motions.load(context.out / name) for name in names])
    models: dict[str, RopeDynamics] = {
        "still": Still(),
        "lstm": LstmDynamics.load(Path(config.weights)),
        "mujoco": MujocoDynamics(config.simulation),
    }
    table = prediction_errors(models, motions)
    with context.atomic("errors.csv") as path:
        table.to_csv(path, index=False)


def _draw(config: DynamicsConfig, context: StageContext, name: str) -> None:
    number = int(Path(name).stem)
    rng = np.random.default_rng([config.seed, number])
    demonstrations = load_demonstrations(Path(config.demonstrations))
    levels = (LEVELS[number % len(LEVELS)],)
    (motions,) = draw_motions(demonstrations, config.simulation, 1, config.per_rope, rng, levels)
    with context.atomic(name) as path:
        motions.save(path)

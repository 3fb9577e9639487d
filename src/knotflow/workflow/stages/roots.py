"""Stage `roots`: how much does it matter which link a rope's chain is rooted in?

Both chains have the same joints. Their mechanics differ by the root's own damping (a head's, on all
six axes, also holds its direction in the world, a middle's only its roll) and, where a moving rope
touches something, by a term that MuJoCo drops. The physics of a crumpling rope is sensitive, so how
far apart the ends are is judged by what halving the time step does to the same splines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.samplers.demonstrations import (
    SHIPPED,
    NoiseConfig,
    aim,
    load_demonstrations,
    noisy_copies,
)
from knotflow.simulation import (
    ROOTS,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    attempt,
    random_trials,
    state_or_none,
)
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage


@dataclass(kw_only=True)
class RootsConfig:
    """What is simulated with either root."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator; its root is set here."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """The random curves that random splines start from."""
    demonstrations: str = runtime(str(SHIPPED))
    """File; its starts, straight and tangled, are those of the aimed splines. What counts is
    `digest`."""
    digest: str
    """Of that file."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """Of the copies of the demonstrated splines, by which success rates are compared."""
    rollouts: int
    """Random splines, and as many aimed ones, whose ends are compared."""
    trials: int
    """Copies of demonstrated splines of each action, shared out among its demonstrations."""
    seed: int = 5
    """Of starts and splines."""


@stage("roots", inputs=())
def compare_roots(config: RootsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes ends.csv (a row a spline) and successes.csv (a row a demonstration and root)."""
    middle, head = (
        RopeSimulator(replace(config.simulation, rope=replace(config.simulation.rope, root=root)))
        for root in ROOTS
    )
    finer = RopeSimulator(replace(middle.config, timestep=middle.config.timestep / 2))
    ends = []
    for name, (points, splines) in context.progress(_splines(config).items(), desc="ends"):
        reached, *others = (
            simulator.execute(points, splines).end_points for simulator in (middle, head, finer)
        )
        table = {"splines": name, "spline": range(len(splines))}
        for other, what in zip(others, ("root", "timestep"), strict=True):
            distance = np.linalg.norm(reached - other, axis=-1).mean(axis=1)
            table[f"{what}_distance_mm"] = np.round(1e3 * distance, 2)
            table[f"{what}_same_state"] = [
                int((state := state_or_none(a)) is not None and state == state_or_none(b))
                for a, b in zip(reached, other, strict=True)
            ]
        ends.append(pd.DataFrame(table))
    with context.atomic("ends.csv") as path:
        pd.concat(ends).to_csv(path, index=False)
    successes = _successes(config, {"middle": middle, "head": head}, context)
    with context.atomic("successes.csv") as path:
        successes.to_csv(path, index=False)


def _splines(config: RootsConfig) -> dict[str, tuple[NDArray, NDArray]]:
    """Ropes (B, V, 3) and splines (B, 6): random on random curves, and aimed at actions."""
    rng, count = np.random.default_rng(config.seed), config.rollouts
    curves, splines = random_trials(config.simulation.rope, count, rng, config.starts)
    demonstrations = load_demonstrations(Path(config.demonstrations))
    shown = [demonstrations[i % len(demonstrations)] for i in range(count)]
    aimed = [aim(one.points, one.task.action, 1, rng)[0] for one in shown]
    return {
        "random": (curves, splines),
        "aimed": (np.stack([one.points for one in shown]), np.stack(aimed)),
    }


def _successes(
    config: RootsConfig, simulators: Mapping[str, RopeSimulator], context: StageContext
) -> pd.DataFrame:
    """Noisy copies of demonstrated splines that lead to the demonstrated state, by root."""
    rng = np.random.default_rng([config.seed, 1])
    demonstrations = load_demonstrations(Path(config.demonstrations))
    of_task = pd.Series([one.task.name for one in demonstrations]).value_counts()
    rows = []
    for number, one in enumerate(context.progress(demonstrations, desc="success of either root")):
        copies = -(-config.trials // int(of_task[one.task.name]))
        splines = noisy_copies(one.spline, copies, rng, config.noise)
        for root, simulator in simulators.items():
            tried = attempt(simulator, one.points, splines, one.task.action, one.task.start_state)
            hits = int(tried.success.sum())
            rows.append((str(one.task.action), number, root, len(splines), hits))
    columns = ["action", "demonstration", "root", "trials", "successes"]
    return pd.DataFrame(rows, columns=columns)

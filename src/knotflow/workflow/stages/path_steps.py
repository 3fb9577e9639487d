"""Stage `path_steps`: what each action of a path leaves for the next one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.planning import parse_goal, parse_rope
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, attempt
from knotflow.topology import TopologicalState, parse_action
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.proposals import point_rows
from knotflow.workflow.stages.recorder import Recorder

STEPS, SHAPES = "steps.csv", "shapes.csv"
SHOWN = 3
"""Ropes of each action in shapes.csv, the first ones, whatever became of them."""


@dataclass(kw_only=True)
class PathStepsConfig:
    """Along which path, from where, and how often each action is tried."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the splines."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a random rope looks like."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """The method; the stages it learns from are inputs of this one."""
    path: str
    """Actions, with blanks between them."""
    ropes: list[str]
    """What the first action begins from: straight, arc or random."""
    shapes: int
    """Ropes from which each action is tried: ends of the one before, drawn among all that
    succeeded."""
    splines: int
    """Tried from each of them."""
    seed: int
    """Of sampling and drawing."""


@stage("path_steps")
def try_steps(config: PathStepsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes steps.csv, shapes.csv and recordings/*.mcap; one shard a rope to begin from.

    A row of steps.csv is a rope on which an action of the path was tried (start, action, shape,
    splines, successes), up to the first action that never succeeds. shapes.csv has the first few of
    these ropes, a row a vertex in metres, head first. Inputs: what the sampler needs.
    """
    parse_goal(config.path, config.simulation.rope)
    context.table(STEPS, partial(_try, config, dict(inputs)), config.ropes, "path_steps")
    with context.atomic(SHAPES) as path:
        shapes = [pd.read_csv(context.out / f"shapes/{name}.csv") for name in config.ropes]
        pd.concat(shapes).to_csv(path, index=False, float_format="%.3f")


def _try(
    config: PathStepsConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> pd.DataFrame:
    rng = np.random.default_rng([config.seed, config.ropes.index(name)])
    sampler, simulator = build_sampler(config.sampler, inputs), RopeSimulator(config.simulation)
    rope = config.simulation.rope
    ropes = np.repeat(parse_rope(name, rope, rng, config.starts)[None], config.shapes, axis=0)
    state = TopologicalState.from_curve(ropes[0])
    recorder, rows, shapes = Recorder(context, config.sampler.name, rope, 0), [], []
    for action in map(parse_action, config.path.split()):
        ends = []
        for shape, points in enumerate(context.progress(ropes, desc=f"{action} from {name}")):
            splines = sampler.sample(points, action, config.splines, rng)
            tried = attempt(simulator, points, splines, action, state, recorder)
            ends += list(tried.rollouts.end_points[tried.success])
            rows.append((name, str(action), shape, config.splines, int(tried.success.sum())))
            if shape < SHOWN:
                shapes.append(point_rows(points, start=name, action=str(action), shape=shape))
        if not ends:
            break
        ropes = np.stack(ends)[rng.permutation(len(ends))[: config.shapes]]
        state = tried.goal
    recorder.save(f"recordings/{name}.mcap")
    with context.atomic(f"shapes/{name}.csv") as path:
        pd.concat(shapes).to_csv(path, index=False, float_format="%.3f")
    return pd.DataFrame(rows, columns=["start", "action", "shape", "splines", "successes"])

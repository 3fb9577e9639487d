"""Stage `plans_pull`: an overhand whose head was pulled out, as by hand (Sec. VII-E)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.planning.pull import HeadPuller, PullConfig, readiest
from knotflow.recording import write_index
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import START_FILE
from knotflow.workflow.stages.recorder import Recorder

PULL = "pull"
"""The source of splines that pull a head out."""
FIRST_PULL = 1_000_000
"""Number of the first pull; branches of the searches that tie are numbered from 0 on."""


@dataclass(kw_only=True)
class PlansPullConfig(PullConfig):
    """What is tied by whom, and how its head is pulled."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator it is done in."""
    sampler: SamplerConfig = field(default_factory=lambda: SamplerConfig("aimed"))
    """The method that ties it; the stages it learns from are inputs of this one."""
    knots: int
    """Ropes tied and pulled, of which one is taken."""


@stage("plans_pull")
def make_pulled(config: PlansPullConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes start.npy and start.csv with the rope (V, 3) in metres, and recordings/*.mcap.

    Raises:
        RuntimeError: no knot could be tied, or none whose head could be pulled out far enough.
    """
    rope = config.simulation.rope
    branches = Recorder(context, config.sampler.name, rope)
    pulls = Recorder(context, PULL, rope, FIRST_PULL)
    sampler = build_sampler(config.sampler, inputs)
    puller = HeadPuller(config, sampler, RopeSimulator(config.simulation), branches, pulls)
    ropes = [puller.pull() for _ in context.progress(range(config.knots), desc="pull")]
    points = readiest(ropes, config.head)
    branches.save("recordings/tie.mcap")
    pulls.save("recordings/pull.mcap")
    write_index(context.out / "recordings")
    with context.atomic("start.csv") as path:
        pd.DataFrame(points, columns=["x", "y", "z"]).to_csv(path, index=False)
    with context.atomic(START_FILE) as path, path.open("wb") as file:
        np.save(file, points)

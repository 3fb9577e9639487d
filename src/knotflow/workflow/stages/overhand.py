"""Stage `overhand`: a plan for one knot in one rope, with everything there is to look at (Fig. 1).

It carries the name of its experiment, for the overhand is what it ties unless asked for another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.planning import (
    ROPE_NAMES,
    PlannerConfig,
    SearchUpdate,
    parse_rope,
    plan_rope,
)
from knotflow.recording import write_index
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import Attempts, SimulationConfig, StartsConfig
from knotflow.viz.plan_folder import write_plan_folder
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.plans import search_row
from knotflow.workflow.stages.recorder import Recorder

TRAINED = "primitives"
"""The sampler that needs a file."""


@dataclass(kw_only=True)
class OverhandConfig:
    """What is tied into which rope, and by whom."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator it is planned in."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a random rope looks like."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """How the tree grows, and when the search gives up."""
    knot: str
    """A knot's name, crossings, or a topological path, see `planning.parse_goal`."""
    rope: str = runtime("random")
    """straight, arc, random, or a file; what counts is what is in it, see `rope_contents`."""
    rope_contents: str = "random"
    """The name of a generated rope, or a hash of the file's contents."""
    seed: int
    """Of the random rope and of the search."""
    sampler: str
    """Who proposes splines: primitives (trained), or aimed (knowledge without learning)."""
    primitives: str = runtime("")
    """The library's file for the sampler `primitives`; what counts is `primitives_contents`."""
    primitives_contents: str = ""
    """A hash of the file's contents."""


@stage("overhand", inputs=())
def plan_one(config: OverhandConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes plan/ (see `write_plan_folder`), branches.csv, and recordings/.

    A search that ends without a knot makes the same files of how far it came; plan/outcome.json
    says which, and what was tried.

    Raises:
        ValueError: an unknown knot, rope or sampler; a rope that cannot be used, is tied already,
            or lies in a state from which no actions lead to the knot.
        FileNotFoundError: no primitives at the given file.
    """
    rope = config.simulation.rope
    points = parse_rope(config.rope, rope, np.random.default_rng([config.seed, 0]), config.starts)
    settings = {"file": config.primitives} if config.sampler == TRAINED else {}
    sampler = build_sampler(SamplerConfig(config.sampler, settings), inputs)
    recorder = Recorder(context, config.sampler, rope)
    last: list[Attempts] = []

    def observe(attempts: Attempts) -> None:
        recorder(attempts)
        last[:] = [attempts]

    rng = np.random.default_rng([config.seed, 1])
    with context.progress(total=config.planner.max_branches, desc="branches") as bar:

        def progress(update: SearchUpdate) -> None:
            bar.update(update.branches - bar.n)

        plan = plan_rope(
            points, config.knot, rng, sampler=sampler, simulation=config.simulation,
            config=config.planner, progress=progress, observe=observe,
        )  # fmt: skip
    if not plan.branches:
        raise ValueError(
            f"no spline was simulated: {plan.reason}; raise planner.max_seconds, which is "
            f"{config.planner.max_seconds:g}"
        )
    recorder.save("recordings/branches.mcap")
    write_index(context.out / "recordings")
    name = config.rope if config.rope in ROPE_NAMES else Path(config.rope).name
    row = search_row(plan, config.knot, name, config.seed)
    with context.atomic("branches.csv") as path:
        pd.DataFrame([row]).to_csv(path, index=False)
    with context.atomic("plan") as folder:
        folder.mkdir()
        write_plan_folder(
            folder, plan, config.sampler, rope, last_tried=last[0], signature=context.signature
        )

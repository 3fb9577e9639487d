"""A plan for one knot in one rope, with everything there is to look at (Fig. 1)."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from knotflow.experiments.common import Recorder, sampler_of
from knotflow.experiments.searches import search_row
from knotflow.planning import PlannerConfig, SearchUpdate, parse_rope, plan_rope
from knotflow.samplers import SamplerConfig
from knotflow.seeding import rng_of
from knotflow.simulation import Attempts, SimulationConfig, StartsConfig
from knotflow.viz.plan_folder import write_plan_folder
from knotflow.workflow import StageRun, stage


@stage
def overhand(
    run: StageRun,
    *,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    knot: str,
    start: str,
    seed: int,
) -> None:
    """Makes plan/ (see `write_plan_folder`), branches.csv, and recordings/ of all expansions.

    `start` is straight, arc, random, or a file, see `planning.parse_rope`; `knot` see `parse_goal`.

    Raises:
        ValueError: see `planning.plan_rope`; or no spline could be simulated in time.
    """
    rope = simulation.rope
    points = parse_rope(start, rope, rng_of(seed, 0), starts)
    recorder = Recorder(run, sampler.name, rope)
    last: list[Attempts] = []

    def observe(attempts: Attempts) -> None:
        recorder(attempts)
        last[:] = [attempts]

    with run.progress(total=planner.max_branches, desc="branches") as bar:

        def progress(update: SearchUpdate) -> None:
            bar.update(update.branches - bar.n)

        plan = plan_rope(
            points, knot, rng_of(seed, 1), sampler=sampler_of(sampler, primitives=primitives),
            simulation=simulation, config=planner, progress=progress, observe=observe,
        )  # fmt: skip
    if not plan.branches:
        raise ValueError(f"no spline was simulated: {plan.reason}; raise planner.max_seconds")
    recorder.save("recordings/branches.mcap")
    run.save_table("branches.csv", pd.DataFrame([search_row(plan, knot, start, seed)]))
    with run.atomic("plan") as folder:
        folder.mkdir()
        write_plan_folder(folder, plan, sampler.name, rope, last_tried=last[0], signature=run.key)

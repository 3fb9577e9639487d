"""Stage `closed_loop`: plans executed on perturbed twins, open loop and otherwise (Sec. VI)."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.execution import (
    CONTROLLERS,
    FAULTS,
    ExecutionConfig,
    ImageRecorder,
    Twin,
    TwinConfig,
    run_trial,
)
from knotflow.perception import Camera, network_of
from knotflow.planning import Goal, KnotPlan, PlannerConfig, parse_goal, plan_knot
from knotflow.samplers.sampler import Sampler, SamplerConfig, build_sampler
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, random_curve
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.closed_loop_shown import show

TABLE = "executions.csv"
FILM = "film"
"""Begins the names of folders in which executions are shown, one a knot and level."""
SHOWN = ("mppi_replan", "", 0)
"""Controller, fault and twin of those."""


@dataclass
class ExecutionCase:
    """Executions of one kind."""

    controller: str
    """One of `execution.CONTROLLERS`."""
    level: int
    """How far the twins are from the planner's model, see `simulation.perturbation`."""
    twins: int
    """How many; the first of a level and knot are the same for every controller."""
    knot: str = "overhand"
    """What is tied, by name."""
    fault: str = ""
    """What goes wrong with robot or camera, one of `execution.FAULTS`; nothing where empty."""

    def __post_init__(self) -> None:
        """Refuse a controller or fault that there is none of."""
        if self.controller not in CONTROLLERS:
            raise ValueError(
                f"unknown controller {self.controller!r}; there are {', '.join(CONTROLLERS)}"
            )
        if self.fault not in FAULTS:
            raise ValueError(f"unknown fault {self.fault!r}; there are {', '.join(FAULTS)}")


@dataclass(kw_only=True)
class ClosedLoopConfig:
    """What is executed, on which twins, and how."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The planner's simulator, and the rope around which the twins' are drawn."""
    starts: StartsConfig = field(default_factory=StartsConfig)
    """What a random rope looks like."""
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    """Who proposes splines; the stages it learns from are inputs of this one."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """How is planned, before an execution and after each action."""
    ensemble: int
    """Perturbed ropes that judge the plans that are to be robust."""
    execution: ExecutionConfig = field(default_factory=ExecutionConfig)
    """Heights, speeds, and when an execution is given up."""
    weights: str = runtime("")
    """File of the learned dynamics; what counts is `weights_contents`."""
    weights_contents: str
    """Digest of what the file holds."""
    network: str = runtime("")
    """File of the network that sees ropes; what counts is `network_contents`."""
    network_contents: str = ""
    """Digest of what the file holds; without a file, the shipped network is used."""
    cases: list[ExecutionCase]
    """What is compared."""
    seed: int
    """Of ropes, plans and twins; used for nothing else."""


Shard = tuple[str, int, int]
"""Knot, level and number of a twin."""


@stage("closed_loop")
def execute_plans(
    config: ClosedLoopConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes executions.csv, a row an execution; one shard a twin, with all of its controllers.

    Inputs: what the sampler needs.
    """
    shards = {
        f"{one.knot}-{one.level}-{twin:03d}": (one.knot, one.level, twin)
        for one in config.cases
        for twin in range(one.twins)
    }
    context.table(TABLE, partial(_shard, config, dict(inputs), shards), [*shards], "twins")


def _shard(
    config: ClosedLoopConfig,
    inputs: Mapping[str, Path],
    shards: Mapping[str, Shard],
    context: StageContext,
    name: str,
) -> pd.DataFrame:
    knot, level, number = shards[name]
    goal = parse_goal(knot, config.simulation.rope)
    planner = _Planner(config, goal, build_sampler(config.sampler, inputs))
    rope = np.random.default_rng([config.seed, number, 0])
    points = random_curve(config.simulation.rope, rope, config.starts)
    cases = [
        one for one in config.cases if (one.knot, one.level) == (knot, level) and number < one.twins
    ]
    robust = {CONTROLLERS[one.controller].robust for one in cases}
    plans = {one: planner.first(points, number, one) for one in sorted(robust)}
    rows = [
        {"controller": one.controller, "level": level, "twin": number, "knot": knot}
        | {"fault": one.fault}
        | _row(
            config, plans[CONTROLLERS[one.controller].robust], goal, one, number, planner, context
        )
        for one in cases
    ]
    return pd.DataFrame(rows)


@dataclass(eq=False)
class _Planner:
    """Plans before an execution and during it."""

    config: ClosedLoopConfig
    goal: Goal
    sampler: Sampler

    def __post_init__(self) -> None:
        self.simulator = RopeSimulator(self.config.simulation)
        self.seconds = 0.0

    def first(self, points: NDArray, number: int, robust: bool) -> KnotPlan:
        """The plan that controllers begin with, the same for all that want it robust or not."""
        planner = replace(self.config.planner, ensemble=self.config.ensemble * robust)
        rng = np.random.default_rng([self.config.seed, number, 1])
        return plan_knot(points, self.goal, self.sampler, self.simulator, rng, planner)

    def anew(self, rng: np.random.Generator, points: NDArray) -> KnotPlan:
        """The plan of the rest, which may undo what went wrong; never a robust one."""
        began = time.perf_counter()
        planner = replace(self.config.planner, ensemble=0)
        plan = plan_knot(points, self.goal, self.sampler, self.simulator, rng, planner)
        self.seconds += time.perf_counter() - began
        return plan


def _row(
    config: ClosedLoopConfig,
    plan: KnotPlan,
    goal: Goal,
    case: ExecutionCase,
    number: int,
    planner: _Planner,
    context: StageContext,
) -> dict[str, object]:
    """What became of one execution; the first of those that are shown is recorded."""
    control, level = CONTROLLERS[case.controller], case.level
    camera = Camera.overhead() if control.state == "vision" else None
    drawn = np.random.default_rng([config.seed, number, 2, level])
    twin = Twin(plan.start, TwinConfig(level=level, rope=config.simulation.rope), drawn, camera)
    planner.seconds = plan.seconds
    anew = partial(planner.anew, np.random.default_rng([config.seed, number, 3, level]))
    weights = Path(config.weights)
    network = None if camera is None else network_of(Path(config.network))
    robot = FAULTS[case.fault](twin.robot())
    film = ImageRecorder(robot) if (case.controller, case.fault, number) == SHOWN else None
    trial = run_trial(
        plan, goal, twin, control, config.execution, anew, camera, weights, network, film or robot
    )
    execution = trial.execution
    if film is not None and camera is not None:
        show(context, f"{FILM}-{case.knot}-{level}", execution, twin, camera, film)
    return {
        "tied": trial.tied,
        "reported": {None: "", True: "yes", False: "no"}[execution.tied],
        "actions_done": len(execution.outcomes),
        "mean_deviation_mm": "" if math.isnan(trial.deviation) else round(1e3 * trial.deviation, 1),
        "seconds": round(float(execution.times[-1]), 1) if len(execution.times) else 0.0,
        "planning_seconds": round(planner.seconds, 1),
        "image_ms": _milliseconds([tick.image for tick in execution.ticks]),
        "track_ms": _milliseconds([tick.track for tick in execution.ticks]),
        "mppi_ms": _milliseconds([tick.control for tick in execution.ticks]),
        "tick_ms": _milliseconds([tick.track + tick.control for tick in execution.ticks]),
        "cause": trial.cause if plan.solved or control.replans else "no plan",
        "reason": execution.reason,
    }


def _milliseconds(seconds: list[float]) -> float | str:
    """Their mean; nothing where nothing was timed."""
    return round(1e3 * float(np.mean(seconds)), 1) if seconds else ""

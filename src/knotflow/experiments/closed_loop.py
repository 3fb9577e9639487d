"""Plans executed under perturbed dynamics, open loop and in closed loop (Sec. VI)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.execution import (
    CONTROLLERS,
    FAULTS,
    DragFrame,
    Execution,
    ExecutionConfig,
    ImageRecorder,
    Twin,
    TwinConfig,
    animate_execution,
    drag_frames,
    draw_execution,
    encode_jpeg,
    run_trial,
)
from knotflow.experiments.common import sampler_of
from knotflow.perception import Camera, load_if_present
from knotflow.planning import Goal, KnotPlan, PlannerConfig, parse_goal, plan_knot
from knotflow.recording import RecordedRollout, RolloutImages, write_recording
from knotflow.samplers import Sampler, SamplerConfig
from knotflow.seeding import rng_of
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, random_curve
from knotflow.workflow import StageRun, stage

RECORDED = ("mppi_replan", "", 0)
"""Controller, fault and twin of the executions that are recorded, one a knot and level."""


@dataclass
class ExecutionCase:
    """Executions of one kind."""

    controller: str
    """One of `execution.CONTROLLERS`."""
    level: int
    """Of the twins' perturbation, see `simulation.perturbation`."""
    twins: int
    """How many; the first of a level and knot are the same for every controller."""
    knot: str = "overhand"
    """What is tied, by name."""
    fault: str = ""
    """Of robot or camera, one of `execution.FAULTS`; none where empty."""

    def __post_init__(self) -> None:
        """Refuse a controller or fault that there is none of."""
        for value, known in ((self.controller, CONTROLLERS), (self.fault, FAULTS)):
            if value not in known:
                raise ValueError(f"there is no {value!r}; there are {', '.join(known)}")


@dataclass(frozen=True)
class _Setup:
    build: partial[Sampler]
    dynamics_weights: Path
    network: Path
    simulation: SimulationConfig
    starts: StartsConfig
    planner: PlannerConfig
    execution: ExecutionConfig
    cases: list[ExecutionCase]
    seed: int


@stage
def closed_loop(
    run: StageRun,
    *,
    primitives: Path | None = None,
    dynamics_weights: Path,
    network: Path,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    execution: ExecutionConfig,
    cases: list[ExecutionCase],
    seed: int,
) -> None:
    """Executions on perturbed twins, all controllers on the same ones; one shard a twin.

    Makes executions.csv, a row an execution, and film-<knot>-<level>/ of those recorded.
    """
    build = partial(sampler_of, sampler, primitives=primitives)
    setup = _Setup(
        build, dynamics_weights, network, simulation, starts, planner, execution, cases, seed
    )
    shards = {
        f"{one.knot}-{one.level}-{twin:03d}": (one.knot, one.level, twin)
        for one in cases
        for twin in range(one.twins)
    }
    run.table("executions.csv", partial(_execute_all, setup, shards), [*shards], "twins")


def _execute_all(
    setup: _Setup, shards: Mapping[str, tuple[str, int, int]], run: StageRun, name: str
) -> pd.DataFrame:
    knot, level, number = shards[name]
    planner = _Planner(setup, parse_goal(knot, setup.simulation.rope))
    points = random_curve(setup.simulation.rope, rng_of(setup.seed, number, 0), setup.starts)
    plan = planner.plan(rng_of(setup.seed, number, 1), points)
    rows = [
        {"controller": one.controller, "level": level, "twin": number, "knot": knot}
        | {"fault": one.fault}
        | _execute(setup, plan, one, number, planner, run)
        for one in setup.cases
        if (one.knot, one.level) == (knot, level) and number < one.twins
    ]
    return pd.DataFrame(rows)


class _Planner:
    """Plans before an execution and during it."""

    def __init__(self, setup: _Setup, goal: Goal) -> None:
        self.goal, self.config, self.seconds = goal, setup.planner, 0.0
        self.sampler, self.simulator = setup.build(), RopeSimulator(setup.simulation)

    def plan(self, rng: np.random.Generator, points: NDArray[np.float64]) -> KnotPlan:
        """A plan from a rope (V, 3), which may undo what went wrong."""
        began = time.perf_counter()
        plan = plan_knot(points, self.goal, self.sampler, self.simulator, rng, self.config)
        self.seconds += time.perf_counter() - began
        return plan


def _execute(
    setup: _Setup,
    plan: KnotPlan,
    case: ExecutionCase,
    number: int,
    planner: _Planner,
    run: StageRun,
) -> dict[str, object]:
    """The outcome of one execution."""
    controller, level = CONTROLLERS[case.controller], case.level
    camera = Camera.overhead() if controller.state == "vision" else None
    config = TwinConfig(level=level, rope=setup.simulation.rope)
    twin = Twin(plan.start, config, rng_of(setup.seed, number, 2, level), camera)
    planner.seconds = plan.seconds
    replan = partial(planner.plan, rng_of(setup.seed, number, 3, level))
    network = None if camera is None else load_if_present(setup.network)
    robot = FAULTS[case.fault](twin.robot())
    film = ImageRecorder(robot) if (case.controller, case.fault, number) == RECORDED else None
    trial = run_trial(
        plan, planner.goal, twin, controller, setup.execution, replan, camera,
        setup.dynamics_weights, network, film or robot,
    )  # fmt: skip
    execution = trial.execution
    if film is not None and camera is not None:
        _record(run, f"film-{case.knot}-{level}", execution, twin, camera, film)
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
        "cause": trial.cause if plan.solved or controller.replans else "no plan",
        "reason": execution.reason,
    }


def _milliseconds(seconds: list[float]) -> float | str:
    """Their mean; empty where nothing was timed."""
    return round(1e3 * float(np.mean(seconds)), 1) if seconds else ""


def _record(
    run: StageRun, folder: str, execution: Execution, twin: Twin, camera: Camera,
    film: ImageRecorder,
) -> None:  # fmt: skip
    """A recording, a picture and an animation of one execution; none where nothing was dragged."""
    frames = drag_frames(execution, twin, film.images)
    with run.atomic(folder) as made:
        made.mkdir()
        if not frames:
            return
        facts = {"source": "execution", "signature": run.key}
        rollouts = _drags(execution, twin, frames, run.key)
        write_recording(made / "execution.mcap", rollouts, facts, rope_line=False)
        draw_execution(made / "execution.png", execution, camera, frames, film.images[-1])
        animate_execution(made / "execution.gif", execution, camera, frames)


def _drags(
    execution: Execution, twin: Twin, frames: Sequence[DragFrame], key: str
) -> Iterator[RecordedRollout]:
    """The drags as rollouts: the true rope, and beside the images the tracked and planned one."""
    for number, outcome in enumerate(execution.outcomes):
        own = [frame for frame in frames if frame.step == number]
        if not own:
            continue
        rows, step = [frame.number for frame in own], outcome.step
        yield RecordedRollout(
            times=execution.times[rows],
            points=np.array(twin.trajectory)[rows].astype(np.float32),
            gripper=execution.gripper[rows].astype(np.float32),
            control_points=step.controls(twin.config.rope.radius),
            spline=step.spline,
            action=str(step.action),
            start_state=str(step.start_state),
            goal_state=str(step.end_state),
            end_state="" if outcome.observed_state is None else str(outcome.observed_state),
            outcome="success" if outcome.observed_state == step.end_state else "failure",
            signature=key,
            source="execution",
            number=number,
            camera=RolloutImages(
                tuple(encode_jpeg(frame.image) for frame in own),
                execution.points[rows].astype(np.float32),
                execution.reference[rows].astype(np.float32),
            ),
        )

"""Plans executed under perturbed dynamics, open loop and in closed loop (Sec. VI)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
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
from knotflow.execution.closed_loop import Trial
from knotflow.experiments.common import sampler_of
from knotflow.perception import Camera, load_if_present
from knotflow.planning import KnotPlan, PlannerConfig, parse_goal, plan_knot
from knotflow.recording import RecordedRollout, RolloutImages, write_recording
from knotflow.samplers import SamplerConfig
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
    rope = simulation.rope
    shards = {
        f"{one.knot}-{one.level}-{twin:03d}": (one.knot, one.level, twin)
        for one in cases
        for twin in range(one.twins)
    }

    def execute_all(name: str) -> pd.DataFrame:
        knot, level, number = shards[name]
        goal, seconds = parse_goal(knot, rope), [0.0]
        proposer, simulator = sampler_of(sampler, primitives=primitives), RopeSimulator(simulation)

        def plan_from(rng: np.random.Generator, points: NDArray[np.float64]) -> KnotPlan:
            """A plan from a rope (V, 3), which may undo what went wrong; notes its time."""
            began = time.perf_counter()
            plan = plan_knot(points, goal, proposer, simulator, rng, planner)
            seconds.append(time.perf_counter() - began)
            return plan

        points = random_curve(rope, rng_of(seed, number, 0), starts)
        plan = plan_from(rng_of(seed, number, 1), points)
        rows = []
        for case in cases:
            if (case.knot, case.level) != (knot, level) or number >= case.twins:
                continue
            controller = CONTROLLERS[case.controller]
            camera = Camera.overhead() if controller.state == "vision" else None
            config = TwinConfig(level=level, rope=rope)
            twin = Twin(plan.start, config, rng_of(seed, number, 2, level), camera)
            seconds[:] = [plan.seconds]
            replan = partial(plan_from, rng_of(seed, number, 3, level))
            sight = None if camera is None else load_if_present(network)
            robot = FAULTS[case.fault](twin.robot())
            recorded = (case.controller, case.fault, number) == RECORDED
            film = ImageRecorder(robot) if recorded else None
            trial = run_trial(
                plan, goal, twin, controller, execution, replan, camera, dynamics_weights, sight,
                film or robot,
            )  # fmt: skip
            if film is not None and camera is not None:
                _record(run, f"film-{knot}-{level}", trial.execution, twin, camera, film)
            rows.append(
                {"controller": case.controller, "level": level, "twin": number, "knot": knot}
                | {"fault": case.fault}
                | _outcome(trial, sum(seconds))
                | {
                    "cause": trial.cause if plan.solved or controller.replans else "no plan",
                    "reason": trial.execution.reason,
                }
            )
        return pd.DataFrame(rows)

    run.table("executions.csv", execute_all, [*shards], "twins")


def _outcome(trial: Trial, planning_seconds: float) -> dict[str, object]:
    """What an execution came to, and the time that it took."""
    execution = trial.execution
    return {
        "tied": trial.tied,
        "reported": {None: "", True: "yes", False: "no"}[execution.tied],
        "actions_done": len(execution.outcomes),
        "mean_deviation_mm": "" if math.isnan(trial.deviation) else round(1e3 * trial.deviation, 1),
        "seconds": round(float(execution.times[-1]), 1) if len(execution.times) else 0.0,
        "planning_seconds": round(planning_seconds, 1),
        "image_ms": _milliseconds([tick.image for tick in execution.ticks]),
        "track_ms": _milliseconds([tick.track for tick in execution.ticks]),
        "mppi_ms": _milliseconds([tick.control for tick in execution.ticks]),
        "tick_ms": _milliseconds([tick.track + tick.control for tick in execution.ticks]),
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

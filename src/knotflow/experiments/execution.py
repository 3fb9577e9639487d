"""Plans executed under perturbed dynamics (Sec. VI), and followed by an arm (Sec. VII-D)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.execution import (
    CONTROLLERS,
    FAULTS,
    Arm,
    ArmReach,
    DragFrame,
    Execution,
    ExecutionConfig,
    Export,
    ImageRecorder,
    Twin,
    TwinConfig,
    drag_frames,
    draw_execution,
    encode_jpeg,
    export_plan,
    find_arm,
    first_untied,
    run_trial,
)
from knotflow.execution.closed_loop import Trial
from knotflow.experiments.common import sampler_of
from knotflow.perception import Camera, StrandNetwork
from knotflow.planning import (
    Hand,
    HandConfig,
    KnotPlan,
    PlannerConfig,
    SurvivalConfig,
    SurvivalSearch,
    TreeSearch,
    parse_goal,
    plan_knot,
)
from knotflow.planning.plan import OUT_OF_REACH
from knotflow.recording import RecordedRollout, RolloutImages, write_recording
from knotflow.samplers import SamplerConfig
from knotflow.seeding import rng_of
from knotflow.simulation import RopeSimulator, SimulationConfig, StartsConfig, random_curve
from knotflow.workflow import StageRun, stage

RECORDED = ("mppi_replan", "", 0)
"""Controller, fault and twin of the executions that are recorded, one a knot and level."""
CHECKED_BETWEEN = 4
"""Configurations checked from one waypoint to the next, where joints move evenly."""
ARM_COLUMNS = [
    *("arm", "plan", "knot", "solved", "reachable", "tied_as_exported", "simulated"),
    *("out_of_reach", "planning_seconds", "waypoints", "unreached", "tip_error_mm", "tip_speed"),
    *("limit_margin_deg", "joint_speed_share", "seconds", "slowed"),
]


@dataclass
class ExecutionCase:
    """Executions of one kind."""

    controller: str  # one of `execution.CONTROLLERS`
    level: int  # of the twins' perturbation, see `simulation.worlds`
    twins: int  # how many; the first of a level and knot are the same for every controller
    knot: str = "overhand"  # what is tied, by name
    fault: str = ""  # of robot or camera, one of `execution.FAULTS`; none where empty

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
    survival: SurvivalConfig,
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
        goal, made = parse_goal(knot, rope), list[KnotPlan]()
        proposer, simulator = sampler_of(sampler, primitives=primitives), RopeSimulator(simulation)

        def plan_from(rng: np.random.Generator, points: NDArray[np.float64]) -> KnotPlan:
            """A plan from a rope (V, 3), which may undo what went wrong."""
            earlier = made[-1] if made else None
            search = TreeSearch(points, goal, proposer, simulator, rng, planner, earlier=earlier)
            made.append(SurvivalSearch(search, survival, rng).run())
            return made[-1]

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
            made[:] = [plan]
            replan = partial(plan_from, rng_of(seed, number, 3, level))
            sight = None if camera is None else StrandNetwork.load(network)
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
                | _outcome(trial, sum(one.seconds for one in made))
                | {"cause": trial.cause if plan.solved or controller.replans else "no plan"}
                | {"reason": trial.execution.reason}
            )
        return pd.DataFrame(rows)

    run.table("executions.csv", execute_all, [*shards], "twins")


def _outcome(trial: Trial, planning_seconds: float) -> dict[str, object]:
    """What an execution came to, and the time that it took."""
    execution = trial.execution
    ticks = {
        "image_ms": [tick.image for tick in execution.ticks],
        "track_ms": [tick.track for tick in execution.ticks],
        "mppi_ms": [tick.control for tick in execution.ticks],
        "tick_ms": [tick.track + tick.control for tick in execution.ticks],
    }
    return {
        "tied": trial.tied,
        "reported": {None: "", True: "yes", False: "no"}[execution.tied],
        "actions_done": len(execution.outcomes),
        "mean_deviation_mm": "" if math.isnan(trial.deviation) else round(1e3 * trial.deviation, 1),
        "seconds": round(float(execution.times[-1]), 1) if len(execution.times) else 0.0,
        "planning_seconds": round(planning_seconds, 1),
    } | {
        name: round(1e3 * float(np.mean(seconds)), 1) if seconds else ""
        for name, seconds in ticks.items()
    }


def _record(
    run: StageRun, folder: str, execution: Execution, twin: Twin, camera: Camera,
    film: ImageRecorder,
) -> None:  # fmt: skip
    """A recording and a picture of one execution; none where nothing was dragged."""
    frames = drag_frames(execution, twin, film.images)
    with run.atomic(folder) as made:
        made.mkdir()
        if not frames:
            return
        facts = {"source": "execution", "signature": run.key}
        rollouts = _drags(execution, twin, frames, run.key)
        write_recording(made / "execution.mcap", rollouts, facts, rope_line=False)
        draw_execution(made / "execution.png", execution, camera, frames, film.images[-1])


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


@stage
def arm(
    run: StageRun,
    *,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    sampler: SamplerConfig,
    planner: PlannerConfig,
    knot: str = "overhand",
    arms: list[str],
    plans: int,
    max_speed: float,
    seed: int,
) -> None:
    """Plans from random ropes, searched for within the reach of each arm and its fingers.

    Arms stand at their default bases.

    Makes trajectories.csv, a row a plan and arm. `arms` are names, see `find_arm`; `max_speed` is
    of the tip, metres per second.
    """
    rope = simulation.rope
    shards = {f"{arm}-{number:03d}": (arm, number) for arm in arms for number in range(plans)}

    def follow(name: str) -> pd.DataFrame:
        (arm, number), simulator = shards[name], RopeSimulator(simulation)
        follower = find_arm(arm)
        followed = ArmReach(follower, simulation=simulation, max_speed=max_speed)
        reach = Hand(rope.radius, HandConfig(), followed)
        points = random_curve(rope, rng_of(seed, number, 0), starts)
        proposer, rng = sampler_of(sampler, primitives=primitives), rng_of(seed, number, 1)
        goal = parse_goal(knot, rope)
        plan = plan_knot(points, goal, proposer, simulator, rng, planner, reach=reach)
        missed = sum(one.branches for one in plan.tried if one.outcome == OUT_OF_REACH)
        row: dict[str, Any] = {"arm": arm, "plan": number, "knot": knot, "solved": plan.solved}
        row |= {"simulated": plan.branches, "out_of_reach": missed}
        row |= {"planning_seconds": round(plan.seconds, 1)}
        row |= {"reachable": False, "tied_as_exported": False}
        if plan.solved:
            export = export_plan(plan, follower, max_speed=max_speed)
            row |= {"reachable": export.reachable} | check_arm(follower, export)
            row["tied_as_exported"] = first_untied(plan, export, simulation) is None
        return pd.DataFrame([row], columns=ARM_COLUMNS)

    run.table("trajectories.csv", follow, [*shards], "plans")


def check_arm(arm: Arm, export: Export) -> dict[str, float]:
    """Measures of an exported trajectory, by the arm's own forward kinematics.

    Errors are of the waypoints that it says it reaches; `limit_margin_deg` is how far any joint
    stays from the ends of its range, degrees.
    """
    joints, times, ik = export.ik.joints, export.times, export.ik
    even = np.linspace(0.0, 1.0, CHECKED_BETWEEN, endpoint=False)
    fine = (times[:-1, None] + np.diff(times)[:, None] * even).ravel()
    passed = np.stack([np.interp(fine, times, joint) for joint in joints.T], axis=1)
    tips, model = arm.tip_positions(passed), arm.model()
    low, high = model.jnt_range[arm.joint_ids(model)].T
    error = np.linalg.norm(arm.tip_positions(joints) - export.waypoints.positions, axis=1)
    speeds = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(fine)
    margin = np.minimum(joints - low, high - joints).min()
    return {
        "waypoints": len(times),
        "unreached": int((~ik.ok).sum()),
        "tip_error_mm": round(1e3 * float(error[ik.ok].max(initial=0.0)), 3),
        "tip_speed": round(float(speeds.max()), 4),
        "limit_margin_deg": round(float(np.rad2deg(margin)), 2),
        "joint_speed_share": round(export.peaks()["joint_speed"], 3),
        "seconds": round(float(times[-1]), 1),
        "slowed": round(export.slowed, 2),
    }

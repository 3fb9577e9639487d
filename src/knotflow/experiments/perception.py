"""Ropes at rest seen in one image: network, estimates, and plans from them (Sec. VI)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.experiments.common import sampler_of, train
from knotflow.perception import (
    Appearance,
    Camera,
    CameraNoiseConfig,
    EstimateConfig,
    RgbdImage,
    RopeEstimate,
    SimulatedCamera,
    StrandNetwork,
    StrandTrainer,
    StrandTrainingConfig,
    TraceError,
    estimate,
    observe,
)
from knotflow.perception.estimation.fitting import nearest_on_chain
from knotflow.perception.io import arrange_pictures, draw_overlay
from knotflow.perception.networks.strands import trace_rope
from knotflow.planning import KnotPlan, PlannerConfig, UnreachableGoalError, parse_goal, plan_knot
from knotflow.samplers import SamplerConfig
from knotflow.samplers.demonstrations import heuristic_any_action
from knotflow.seeding import rng_of
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    check_points,
    random_curve,
    resample,
    state_or_none,
)
from knotflow.simulation.proportions import rope_of
from knotflow.topology import DegenerateCurveError, TopologicalState
from knotflow.workflow import StageRun, stage

ROPES, WEIGHTS = "ropes.npz", "network.safetensors"
SHARD_ROPES = 32  # ropes of a shard of `ropes`
NOMINAL = 1.0
"""Level of noise of the images that are drawn, and at which all methods are compared."""
FULL = "full"
"""The complete method, whose estimates are drawn."""
KNOT = "overhand"


@stage
def ropes(
    run: StageRun,
    *,
    simulation: SimulationConfig,
    starts: StartsConfig,
    shards: int,
    rounds: int,
    random_share: float = 0.25,
    most_crossings: int = 5,
    diameters: tuple[float, float] | None = None,
    seed: int,
) -> None:
    """Rope shapes as plans meet them: random curves moved by spline after spline.

    Makes ropes.npz: `points` (N, V, 3) float32, metres, their number of `crossings` (N,) and
    `diameters` (N,), metres.

    `rounds` splines move each rope, `random_share` of them random, the others aimed at an action;
    every shape with at most `most_crossings` is kept. Each shard's diameter is drawn
    log-uniformly from a range of `diameters`, metres, if one is given.
    """
    names = [f"shard-{number:04d}" for number in range(shards)]

    def move(shard: str) -> None:
        rng, rope = rng_of(seed, names.index(shard)), simulation.rope
        if diameters is not None:
            diameter = float(np.exp(rng.uniform(*np.log(diameters))))
            rope = rope_of(diameter / rope.length, rope.bending_length / rope.length, rope.links)
        simulator = RopeSimulator(replace(simulation, rope=rope))
        current = np.stack([random_curve(rope, rng, starts) for _ in range(SHARD_ROPES)])
        states = [TopologicalState.trivial()] * SHARD_ROPES
        points, crossings = [*current.copy()], [0] * SHARD_ROPES
        for _ in range(rounds):
            splines = np.stack(
                [
                    heuristic_any_action(one, state, rng, random_share, most_crossings)
                    for one, state in zip(current, states, strict=True)
                ]
            )
            rollouts = simulator.execute(current, splines)
            ends = zip(rollouts.end_points, rollouts.diverged, strict=True)
            for index, (end, diverged) in enumerate(ends):
                state = None if diverged else state_or_none(end)
                if state is None or state.num_crossings > most_crossings:
                    continue
                middle = 0.5 * (end[:, :2].max(0) + end[:, :2].min(0))
                current[index], states[index] = end - [*middle, 0.0], state
                points.append(current[index].copy())
                crossings.append(state.num_crossings)
        with run.atomic(f"{shard}.npz") as path:
            kept, each = np.stack(points).astype(np.float32), np.array(crossings)
            drawn = np.full(len(kept), 2 * rope.radius)
            np.savez(path, points=kept, crossings=each, diameters=drawn)

    run.each(move, run.pending(names, ".npz"), "ropes")
    parts = [np.load(run.out / f"{name}.npz") for name in names]
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    with run.atomic(ROPES) as path:
        points, count, diameter = (joined[key] for key in ("points", "crossings", "diameters"))
        np.savez(path, points=points, crossings=count, diameters=diameter)
    for name in names:
        (run.out / f"{name}.npz").unlink()


@stage
def strand_training(
    run: StageRun, *, ropes: Path, training: StrandTrainingConfig, seed: int
) -> None:
    """A network learns to follow strands, from windows along them.

    Makes network.safetensors, in half precision, and curves.csv.
    """
    with np.load(ropes / ROPES) as shapes:
        points, crossings, radii = shapes["points"], shapes["crossings"], shapes["diameters"] / 2
    trainer = StrandTrainer(points, crossings, radii, training, seed)
    train(run, trainer, "strands", WEIGHTS, trainer.model.save)


NETWORK_RENDERING = "network_rendering"
ABLATED = ("colour", "network", "depth")
METHODS = (NETWORK_RENDERING, FULL, *(f"{FULL}_without_{part}" for part in ABLATED))
"""What the experiment compares: the network's likeliest path, fitted; the complete method; and this
without the guess by colour, the network's guesses, or depth in the gradient steps."""


def estimate_by(
    method: str,
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    config: EstimateConfig,
    network: StrandNetwork,
) -> RopeEstimate | None:
    """The rope in an image by one of `METHODS`; None where none is found."""
    guess = None
    if method == NETWORK_RENDERING:
        guess = next(iter(trace_rope(network, observe(image, camera, rope))), None)
        if guess is None:
            return None
    elif method == f"{FULL}_without_colour":
        config = replace(config, colour=False)
    elif method == f"{FULL}_without_network":
        config = replace(config, proposals=0)
    elif method == f"{FULL}_without_depth":
        config = replace(config, fit=replace(config.fit, depth=0.0))
    with suppress(TraceError):
        return estimate(image, camera, rope, guess, config, network=network)
    return None


def choose_ropes(
    path: Path,
    crossings: Sequence[int],
    count: int,
    rope: RopeConfig,
    camera: Camera,
    seed: int,
) -> dict[str, tuple[NDArray, RopeConfig]]:
    """At most `count` shapes (V, 3), metres, in a camera's view, of each number of crossings, drawn
    from the file of the stage `ropes`, and their ropes; by name, such as "3-0", the first one of
    three crossings.

    Raises:
        ValueError: no rope of a number of crossings.
    """
    with np.load(path) as file:
        points, of_each = file["points"].astype(np.float64), file["crossings"]
        radii = file["diameters"] / 2
    rng = rng_of(seed, 0)
    pixels, chosen = camera.project(points)[..., :2], {}
    last = [camera.width - 5, camera.height - 5]  # with some pixels to spare
    in_view = ((pixels > 4) & (pixels < last)).all(axis=(1, 2))
    for number in crossings:
        rows = np.flatnonzero(in_view & (of_each == number))
        if not len(rows):
            raise ValueError(
                f"{path} has no rope of {number} crossings in the camera's view: raise "
                "unseen_ropes.shards"
            )
        if len(rows) < count:
            print(f"only {len(rows)} ropes of {number} crossings are in view", flush=True)
        for place, row in enumerate(rng.permutation(rows)[:count]):
            own = replace(rope, radius=float(radii[row]))
            chosen[f"{number}-{place}"] = check_points(resample(points[row], own), own), own
    return chosen


def metrics(found: RopeEstimate | None, truth: NDArray) -> dict[str, Any]:
    """How far an estimate is from the true rope (V, 3); empty where no rope was found."""
    if found is None:
        empty = dict.fromkeys(("mean_error_mm", "off_curve_error_mm"), np.nan)
        return empty | dict.fromkeys(("state_correct", "head_correct"), 0) | {"doubtful": 1}
    error = 1e3 * np.linalg.norm(found.points - truth, axis=1)
    reversed_error = 1e3 * np.linalg.norm(found.points[::-1] - truth, axis=1)
    off = np.linalg.norm(nearest_on_chain(found.points, truth)[2], axis=1)
    return {
        "mean_error_mm": round(float(error.mean()), 3),
        "off_curve_error_mm": round(float(1e3 * off.mean()), 3),
        "state_correct": int(found.state == state_or_none(truth)),
        "head_correct": int(error.mean() < reversed_error.mean()),
        "doubtful": int(found.ambiguous),
    }


@stage
def perception(
    run: StageRun,
    *,
    ropes: Path,
    network: Path,
    rope: RopeConfig,
    estimate: EstimateConfig = EstimateConfig(),
    camera_noise: CameraNoiseConfig = CameraNoiseConfig(),
    levels: list[float],
    crossings: list[int],
    per_crossings: int,
    compared: int,
    distance: float = 0.8,
    seed: int,
) -> None:
    """Ropes at rest, estimated from one image, by noise and number of crossings.

    Makes estimates.csv, a row a method, level and rope, and estimates.png, what the complete method
    makes of the first rope of each number of crossings at the nominal level.

    `per_crossings` ropes of each number of `crossings`, each seen at every level of noise from
    `distance`, metres, above: from 0.8 m a rope of 4 mm is two pixels wide. Methods other than
    the complete one are compared at the nominal level only, on the first `compared` ropes of each
    number of crossings.

    Raises:
        ValueError: no rope of a number of crossings.
    """
    camera = Camera.overhead(distance=distance)
    shapes = choose_ropes(ropes / ROPES, crossings, per_crossings, rope, camera, seed)

    def estimate_rope(name: str) -> pd.DataFrame:
        (truth, own), trained = shapes[name], StrandNetwork.load(network)
        count, number = map(int, name.split("-"))
        rows = []
        for level in levels:
            rng = rng_of(seed, 1, count, number, round(100 * level))
            noise = replace(camera_noise, level=level)
            simulated = SimulatedCamera(camera, own, noise, Appearance.draw(rng, noise))
            image = simulated.capture(truth, rng)
            for method in METHODS if level == NOMINAL and number < compared else (FULL,):
                began = time.process_time()
                found = estimate_by(method, image, camera, own, estimate, trained)
                seconds = time.process_time() - began
                row = {"method": method, "noise": level, "crossings": count, "rope": number}
                row["diameter_mm"] = round(2e3 * own.radius, 1)
                rows.append(row | metrics(found, truth) | {"seconds": round(seconds, 3)})
                if found is not None and (method, level, number) == (FULL, NOMINAL, 0):
                    with run.atomic(f"estimate-{count}.png") as path:
                        draw_overlay(path, image, camera, own, found)
        return pd.DataFrame(rows)

    run.table("estimates.csv", estimate_rope, [*shapes], "perception")
    overlays = sorted(run.out.glob("estimate-*.png"))
    if overlays:
        with run.atomic("estimates.png") as path:
            arrange_pictures(overlays, path)
    for overlay in overlays:
        overlay.unlink()


@stage
def perceived_plans(
    run: StageRun,
    *,
    network: Path,
    primitives: Path | None = None,
    simulation: SimulationConfig,
    starts: StartsConfig,
    camera_noise: CameraNoiseConfig = CameraNoiseConfig(),
    estimate: EstimateConfig = EstimateConfig(),
    sampler: SamplerConfig,
    planner: PlannerConfig,
    ropes: int,
    seed: int,
) -> None:
    """The overhand planned from ropes as they are estimated, and as they are.

    Both plans are executed open loop on the true rope in the planner's simulator. Makes plans.csv,
    a row a rope and shape planned from (true or estimated).
    """
    camera, rope = Camera.overhead(), simulation.rope

    def plan_and_execute(
        points: NDArray[np.float64] | None, truth: NDArray[np.float64], number: int
    ) -> dict[str, Any]:
        """Outcome of a plan from a shape (V, 3), metres, executed on the true one; a shape that
        was not found, or from which no actions lead to the knot, has none."""
        row: dict[str, Any] = {"planned": 0, "tied": 0, "simulated": 0, "mean_error_mm": np.nan}
        if points is None:
            return row
        error = 1e3 * np.linalg.norm(points - truth, axis=1).mean()
        row["mean_error_mm"] = round(float(error), 3)
        simulator, rng = RopeSimulator(simulation), rng_of(seed, number, 1)
        goal, proposer = parse_goal(KNOT, rope), sampler_of(sampler, primitives=primitives)
        try:
            plan = plan_knot(points, goal, proposer, simulator, rng, planner)
        except (UnreachableGoalError, DegenerateCurveError):
            return row
        tied = plan.solved and _ties(plan, truth, simulator)
        return row | {"planned": int(plan.solved), "tied": int(tied), "simulated": plan.branches}

    def plan_both(name: str) -> pd.DataFrame:
        rng = rng_of(seed, int(name))
        truth = random_curve(rope, rng, starts)
        simulated = SimulatedCamera(camera, rope, camera_noise, Appearance.draw(rng, camera_noise))
        image, shapes = simulated.capture(truth, rng), {"true": truth, "estimated": None}
        found = estimate_by(FULL, image, camera, rope, estimate, StrandNetwork.load(network))
        if found is not None:
            shapes["estimated"] = found.points
        return pd.DataFrame(
            {"rope": name, "planned_from": shape} | plan_and_execute(points, truth, int(name))
            for shape, points in shapes.items()
        )

    run.table("plans.csv", plan_both, [f"{one:03d}" for one in range(ropes)], "perceived plans")


def _ties(plan: KnotPlan, truth: NDArray[np.float64], simulator: RopeSimulator) -> bool:
    """Whether a plan's splines, one after the other, tie the knot into a rope (V, 3)."""
    rope = truth
    for step in plan.steps:
        rollouts = simulator.execute(rope[None], step.spline[None])
        if rollouts.diverged[0]:
            return False
        rope = rollouts.end_points[0]
    return state_or_none(rope) in plan.goal_states

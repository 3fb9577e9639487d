"""Ropes at rest seen in one image: networks, estimates, and plans from them (Sec. VI)."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
    CoarseToFineTrainer,
    EstimateConfig,
    Label,
    Network,
    RgbdImage,
    RopeEstimate,
    SelfSupervisionConfig,
    SimulatedCamera,
    StrandTrainer,
    StrandTrainingConfig,
    TraceError,
    TrainingConfig,
    add_noise,
    estimate,
    observe,
    segment,
    self_supervise,
)
from knotflow.perception.estimation.estimate import propose
from knotflow.perception.estimation.fitting import nearest_on_chain
from knotflow.perception.io import DrawnEstimate, draw_estimates
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
from knotflow.topology import DegenerateCurveError, TopologicalState
from knotflow.workflow import StageRun, stage

POOR = 0.03  # root mean square error of a poor start, metres
SUPERVISED, SELF_SUPERVISED = "supervised", "self_supervised"
"""Networks: as trained on simulated ropes, and after learning from images alone besides; both have
the same network that follows strands."""
MARKED, PLAIN, COARSE = "marked", "plain", "coarse"
"""Images of a rope: its head coloured, not coloured, and coloured with half as many pixels along
each side."""
ROPES, WEIGHTS = "ropes.npz", "network.safetensors"
SHARD_ROPES = 32  # ropes of a shard of `ropes`
NOMINAL = 1.0
"""Level of noise of the images that are drawn, and at which all methods are compared."""
CAMERAS = {MARKED: Camera.overhead(), PLAIN: Camera.overhead(), COARSE: Camera.overhead(320, 240)}
"""Camera of a method's view of a rope."""
DRAWN = "network_tracing_rendering"
"""The method whose estimates are drawn."""
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
    seed: int,
) -> None:
    """Rope shapes as plans meet them: random curves moved by spline after spline.

    Makes ropes.npz: `points` (N, V, 3) float32, metres, and their number of `crossings` (N,).

    `rounds` splines move each rope, `random_share` of them random, the others aimed at an action;
    every shape with at most `most_crossings` is kept.
    """
    names = [f"shard-{number:04d}" for number in range(shards)]

    def move(shard: str) -> None:
        rng, simulator = rng_of(seed, names.index(shard)), RopeSimulator(simulation)
        current = np.stack([random_curve(simulation.rope, rng, starts) for _ in range(SHARD_ROPES)])
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
            kept = np.stack(points).astype(np.float32)
            np.savez(path, points=kept, crossings=np.array(crossings))

    run.each(move, run.pending(names, ".npz"), "ropes")
    parts = [np.load(run.out / f"{name}.npz") for name in names]
    joined = {key: np.concatenate([part[key] for part in parts]) for key in ("points", "crossings")}
    with run.atomic(ROPES) as path:
        np.savez(path, points=joined["points"], crossings=joined["crossings"])
    for name in names:
        (run.out / f"{name}.npz").unlink()


@stage
def perception_training(
    run: StageRun, *, ropes: Path, rope: RopeConfig, training: TrainingConfig, seed: int
) -> None:
    """A network learns to see whole ropes, from drawings of their shapes.

    Makes network.safetensors, in half precision, and curves.csv.
    """
    with np.load(ropes / ROPES) as shapes:
        trainer = CoarseToFineTrainer(shapes["points"], shapes["crossings"], rope, training, seed)
    train(run, trainer, "perception", WEIGHTS, lambda path: Network(trainer.model).save(path))


@stage
def strand_training(
    run: StageRun,
    *,
    ropes: Path,
    network: Path,
    rope: RopeConfig,
    training: StrandTrainingConfig,
    seed: int,
) -> None:
    """A network learns to follow strands, from windows along them.

    Makes network.safetensors, of both networks, and curves.csv.
    """
    whole = Network.load(network / WEIGHTS if network.is_dir() else network)
    with np.load(ropes / ROPES) as shapes:
        trainer = StrandTrainer(shapes["points"], shapes["crossings"], rope, training, seed)

    def save(path: Path) -> None:
        Network(whole.model, trainer.model).save(path)

    train(run, trainer, "strands", WEIGHTS, save)


@stage
def perception_networks(
    run: StageRun,
    *,
    ropes: Path,
    network: Path,
    rope: RopeConfig,
    camera_noise: CameraNoiseConfig = CameraNoiseConfig(),
    images: int,
    estimate: EstimateConfig = EstimateConfig(),
    learning: SelfSupervisionConfig,
    seed: int,
) -> None:
    """The network that sees ropes, before and after self-supervision on images alone.

    Makes supervised.safetensors, self_supervised.safetensors, losses.csv, a row a step, and
    shapes/NUMBER.npy, the estimate of each image: (V, 3), or (0, 3) where it is ambiguous.

    `ropes` serve to take the images only.
    """
    with run.atomic(f"{SUPERVISED}.safetensors") as path:
        shutil.copyfile(network, path)
    shapes, camera = _balanced(ropes / ROPES, images, rope, rng_of(seed)), Camera.overhead()
    names = [f"shapes/{number}" for number in range(len(shapes))]

    def picture(number: int) -> RgbdImage:
        """The image of a rope, which has a light and noise of its own."""
        rng = rng_of(seed, number)
        look = Appearance.draw(rng, camera_noise)
        return SimulatedCamera(camera, rope, camera_noise, look).capture(shapes[number], rng)

    def see(name: str) -> None:
        image = picture(names.index(name))
        found = _estimated(image, camera, rope, estimate, Network.load(network))
        shape = np.empty((0, 3)) if found is None or found.ambiguous else found.points
        with run.atomic(f"{name}.npy") as path, open(path, "wb") as file:
            np.save(file, shape)  # given a path, it would append an ending

    run.each(see, run.pending(names, ".npy"), "estimates")
    found = {number: np.load(run.out / f"{name}.npy") for number, name in enumerate(names)}
    sure = [number for number, shape in found.items() if len(shape)]
    print(f"{len(sure)} of {len(shapes)} images are unambiguous", flush=True)
    learned, losses = Network.load(network), []
    if sure:
        pictures, targets = [picture(one) for one in sure], [found[one] for one in sure]
        supervision = self_supervise(learned, pictures, targets, camera, rope, learning, seed)
        losses = [*run.progress(supervision, total=learning.steps, desc="self-supervision")]
    table = pd.DataFrame({"loss": losses}).rename_axis("step").reset_index()
    run.save_table("losses.csv", table, "%.6g")
    with run.atomic(f"{SELF_SUPERVISED}.safetensors") as path:
        learned.save(path)


def load_networks(folder: Path) -> dict[str, Network]:
    """The networks in the output of `perception_networks`, by name."""
    names = (SUPERVISED, SELF_SUPERVISED)
    return {name: Network.load(folder / f"{name}.safetensors") for name in names}


def _balanced(
    path: Path, count: int, rope: RopeConfig, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Ropes (V, 3) drawn from a file, all numbers of crossings equally often."""
    with np.load(path) as file:
        points, crossings = file["points"].astype(np.float64), file["crossings"]
    share = 1 / np.bincount(crossings)[crossings]
    count = min(count, len(points))
    rows = rng.choice(len(points), count, replace=False, p=share / share.sum())
    return [resample(points[row], rope) for row in rows]


def _estimated(
    image: RgbdImage, camera: Camera, rope: RopeConfig, config: EstimateConfig, network: Network
) -> RopeEstimate | None:
    """The rope in an image; None where none can be traced."""
    try:
        return estimate(image, camera, rope, config=config, network=network)
    except TraceError:
        return None


@dataclass(frozen=True)
class EstimationMethod:
    """Where an estimate starts, and what it does then.

    With both starts, the fit that accounts best for the image counts; with neither, it starts from
    the true shape moved by `POOR`.
    """

    tracing: bool = False  # start from the paths through the mask's skeleton
    network: str | None = SELF_SUPERVISED
    """Start from the guess of `SUPERVISED` or `SELF_SUPERVISED`."""
    strands: bool = True  # whether the network's guesses come from following strands, too
    rendering: bool = True
    """Fit by gradient steps on the rendering; otherwise the start is the estimate."""
    depth: bool = True  # let these steps see depth
    view: str = MARKED
    """Its image; on that of a `PLAIN` rope an earlier shape, off by `POOR`, tells the head."""

    def estimate(
        self,
        image: RgbdImage,
        camera: Camera,
        rope: RopeConfig,
        config: EstimateConfig,
        networks: Mapping[str, Network],
        truth: NDArray,
        rng: np.random.Generator,
    ) -> RopeEstimate:
        """The rope in an image of a camera, with networks by name; the `truth` (V, 3), metres, is
        for poor starts and earlier shapes, which `rng` draws.

        Raises:
            TraceError: there is no rope in the image.
        """
        network = None if self.network is None else networks[self.network]
        if network is not None and not self.strands:
            network = Network(network.model)
        if not self.depth:
            config = replace(config, fit=replace(config.fit, depth=0.0))
        if self.tracing:
            config = replace(config, propose=network is not None)
            earlier = _moved(truth, rope, rng) if self.view == PLAIN else None
            return estimate(image, camera, rope, None, config, earlier, network)
        if network is None:
            return estimate(image, camera, rope, _moved(truth, rope, rng), config)
        if not self.rendering:
            return propose(image, camera, rope, network)
        guess = network.guesses(observe(image, camera, rope))[0]
        return estimate(image, camera, rope, guess, config)


NETWORK = EstimationMethod(rendering=False)
TRACED = EstimationMethod(tracing=True, network=None)
BOTH = EstimationMethod(tracing=True)
METHODS = {
    "rendering": TRACED,
    "rendering_without_depth": replace(TRACED, depth=False),
    "rendering_poor_start": replace(TRACED, tracing=False),
    "network": NETWORK,
    "network_without_strands": replace(NETWORK, strands=False),
    "network_without_strands_self_supervision": replace(NETWORK, strands=False, network=SUPERVISED),
    "network_rendering": EstimationMethod(),
    "network_tracing_rendering": BOTH,
    "network_tracing_rendering_without_strands": replace(BOTH, strands=False),
    "network_tracing_rendering_plain_rope": replace(BOTH, view=PLAIN),
    "network_tracing_rendering_coarse": replace(BOTH, view=COARSE),
}
"""What the experiment compares, by name."""
EVERY_LEVEL = [
    *("network", "network_rendering", "network_tracing_rendering"),
    "network_tracing_rendering_coarse",
]
"""Methods compared at all levels of noise; others at the nominal one only."""


def _moved(truth: NDArray, rope: RopeConfig, rng: np.random.Generator) -> NDArray[np.float64]:
    """A shape (V, 3) moved by `POOR`, smoothly along the rope."""
    waves = np.sin(np.pi * np.outer(np.linspace(0, 1, len(truth)), np.arange(1, 5)))  # (V, 4)
    off = waves @ rng.normal(size=(4, 2)) + rng.normal(size=2)
    off *= POOR / np.sqrt((off**2).sum(axis=1).mean())
    return resample(truth + np.pad(off, ((0, 0), (0, 1))), rope)


def choose_ropes(
    path: Path, crossings: Sequence[int], count: int, rope: RopeConfig, seed: int
) -> dict[tuple[int, int], NDArray]:
    """At most `count` shapes (V, 3), metres, in view, of each number of crossings, by that and a
    count, drawn from the file of the stage `ropes`.

    Raises:
        ValueError: no rope of a number of crossings.
    """
    with np.load(path) as file:
        points, of_each = file["points"].astype(np.float64), file["crossings"]
    rng = rng_of(seed, 0)
    camera = Camera.overhead()
    chosen: dict[tuple[int, int], NDArray] = {}
    for number in crossings:
        rows = [row for row in np.flatnonzero(of_each == number) if _in_view(points[row], camera)]
        if not rows:
            raise ValueError(
                f"{path} has no rope of {number} crossings in the camera's view: raise "
                "perception.shards"
            )
        if len(rows) < count:
            print(f"only {len(rows)} ropes of {number} crossings are in view", flush=True)
        for place, row in enumerate(rng.permutation(rows)[:count]):
            chosen[number, place] = check_points(resample(points[row], rope), rope)
    return chosen


def _in_view(points: NDArray, camera: Camera) -> bool:
    """Whether the whole rope is seen, with some pixels to spare."""
    pixels = camera.project(points)[:, :2]
    return bool(pixels.min() > 4 and (pixels < [camera.width - 5, camera.height - 5]).all())


def _noisy_image(
    camera: SimulatedCamera, truth: NDArray, rng: np.random.Generator
) -> tuple[RgbdImage, float]:
    """An image with noise, and how well its segmented rope overlaps that rendered (IoU)."""
    view = camera.view(truth)
    image = add_noise(view.image, camera.camera, camera.noise, rng)
    found = segment(image, camera.camera, camera.rope.radius).rope
    there = view.labels == Label.ROPE
    return image, float((found & there).sum() / (found | there).sum())


def metrics(found: RopeEstimate | None, truth: NDArray) -> dict[str, Any]:
    """How far an estimate is from the true rope (V, 3); empty where no rope was found."""
    if found is None:
        empty = dict.fromkeys(("mean_error_mm", "p95_error_mm", "off_curve_error_mm"), np.nan)
        return empty | dict.fromkeys(("state_correct", "head_correct"), 0) | {"doubtful": 1}
    error = 1e3 * np.linalg.norm(found.points - truth, axis=1)
    reversed_error = 1e3 * np.linalg.norm(found.points[::-1] - truth, axis=1)
    off = np.linalg.norm(nearest_on_chain(found.points, truth)[2], axis=1)
    return {
        "mean_error_mm": round(float(error.mean()), 3),
        "p95_error_mm": round(float(np.quantile(error, 0.95)), 3),
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
    networks: Path,
    rope: RopeConfig,
    estimate: EstimateConfig = EstimateConfig(),
    camera_noise: CameraNoiseConfig = CameraNoiseConfig(),
    methods: list[str] = [*METHODS],
    levels: list[float],
    crossings: list[int],
    per_crossings: int,
    seed: int,
) -> None:
    """Ropes at rest, estimated from one image, by noise and number of crossings.

    Makes estimates.csv, a row a method, level and rope, and estimates.png.

    `per_crossings` ropes of each number of `crossings`, each seen at every level of noise; some
    methods are compared at the nominal level only.

    Raises:
        ValueError: an unknown method, or no rope of a number of crossings.
    """
    if unknown := sorted({*methods} - {*METHODS}):
        raise ValueError(f"unknown methods {unknown}; methods are: {', '.join(METHODS)}")
    chosen = choose_ropes(ropes / ROPES, crossings, per_crossings, rope, seed)
    shapes = {f"{count}-{number}": shape for (count, number), shape in chosen.items()}

    def estimate_rope(name: str) -> pd.DataFrame:
        truth, trained = shapes[name], load_networks(networks)
        count, number = map(int, name.split("-"))
        rows = []
        for level in levels:
            rng = rng_of(seed, 1, count, number, round(100 * level))
            noise = replace(camera_noise, level=level)
            appearance = Appearance.draw(rng, noise)
            compared = [one for one in methods if level == NOMINAL or one in EVERY_LEVEL]
            looks = {MARKED: appearance, PLAIN: replace(appearance, head=None), COARSE: appearance}
            images = {
                view: _noisy_image(SimulatedCamera(CAMERAS[view], rope, noise, look), truth, rng)
                for view, look in looks.items()
                if any(METHODS[one].view == view for one in compared)
            }
            for method in compared:
                how = METHODS[method]
                image, rope_iou = images[how.view]
                began = time.process_time()
                try:
                    camera = CAMERAS[how.view]
                    found = how.estimate(image, camera, rope, estimate, trained, truth, rng)
                except TraceError:
                    found = None
                seconds = time.process_time() - began
                rows.append(
                    {"method": method, "noise": level, "crossings": count, "rope": number}
                    | metrics(found, truth)
                    | {"rope_iou": round(rope_iou, 4), "seconds": round(seconds, 3)}
                )
                if found is not None and (method, level, number) == (DRAWN, NOMINAL, 0):
                    with run.atomic(f"drawn/{count}.npz") as path:
                        points, visible = found.points, found.visible
                        np.savez(path, rgb=image.rgb, found=points, visible=visible, truth=truth)
        return pd.DataFrame(rows)

    run.table("estimates.csv", estimate_rope, [*shapes], "perception")
    drawn = []
    for path in sorted((run.out / "drawn").glob("*.npz")):
        with np.load(path) as file:
            drawn.append(DrawnEstimate(**file))
    if drawn:
        with run.atomic("estimates.png") as path:
            draw_estimates(path, drawn, Camera.overhead(), rope)


@stage
def perceived_plans(
    run: StageRun,
    *,
    networks: Path,
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
        row: dict[str, Any] = {"planned": 0, "tied": 0, "branches": 0, "seconds": 0.0}
        if points is None:
            return row | {"mean_error_mm": np.nan}
        error = 1e3 * np.linalg.norm(points - truth, axis=1).mean()
        row["mean_error_mm"] = round(float(error), 3)
        simulator, rng = RopeSimulator(simulation), rng_of(seed, number, 1)
        goal, proposer = parse_goal(KNOT, rope), sampler_of(sampler, primitives=primitives)
        try:
            plan = plan_knot(points, goal, proposer, simulator, rng, planner)
        except (UnreachableGoalError, DegenerateCurveError):
            return row
        row |= {"branches": plan.branches, "seconds": round(plan.seconds, 3)}
        tied = plan.solved and _ties(plan, truth, simulator)
        return row | {"planned": int(plan.solved), "tied": int(tied)}

    def plan_both(name: str) -> pd.DataFrame:
        rng = rng_of(seed, int(name))
        truth = random_curve(rope, rng, starts)
        simulated = SimulatedCamera(camera, rope, camera_noise, Appearance.draw(rng, camera_noise))
        network = load_networks(networks)[SELF_SUPERVISED]
        found = _estimated(simulated.capture(truth, rng), camera, rope, estimate, network)
        seen = None if found is None else found.points
        rows = [
            {"rope": name, "planned_from": planned_from}
            | plan_and_execute(points, truth, int(name))
            for planned_from, points in (("true", truth), ("estimated", seen))
        ]
        return pd.DataFrame(rows)

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

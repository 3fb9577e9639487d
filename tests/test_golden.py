"""What each package computes stays as it is until the package raises its version.

    python tests/test_golden.py             # write the golden files of raised versions
    python tests/test_golden.py simulation  # or of one package

New outcomes are added to a file, without a raised version, by the same command.

tests/golden/<package>.json holds a few outcomes, and the versions (`knotflow.versions`) of the
package and of those it uses. Two machines differ in the last bits, and a rope on a table makes much
of them, so rollouts are compared while they are young, and numbers with a tolerance.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from knotflow.execution import (
    ERROR_LEVELS,
    FREE,
    LstmConfig,
    LstmDynamics,
    Twin,
    TwinConfig,
    panda,
)
from knotflow.execution.arm.timing import keep_limits
from knotflow.execution.mppi import Mppi, MppiConfig
from knotflow.execution.step_executor import path_from_grasp
from knotflow.perception import (
    Appearance,
    Camera,
    CameraNoiseConfig,
    SimulatedCamera,
    Tracker,
    add_noise,
    estimate,
    observe,
    segment,
)
from knotflow.perception.estimation.crossings import (
    crossing_fractions,
    exchange_heights,
    score_crossings,
)
from knotflow.planning import PlannerConfig, PlanStep, SolutionDag, parse_goal, plan_knot
from knotflow.planning.config import RULES
from knotflow.planning.rules import Node, PosteriorRule, node_probabilities
from knotflow.recording import load, read_recording, recorded, write_recording
from knotflow.samplers import RandomSampler
from knotflow.samplers.causal_infogan.data import StartFrame
from knotflow.samplers.causal_infogan.evaluation import measure
from knotflow.samplers.demonstrations import (
    TASKS,
    NoiseConfig,
    heuristic_splines,
    noisy_copies,
)
from knotflow.samplers.demonstrations.prediction import screened_splines
from knotflow.samplers.icp import align
from knotflow.samplers.primitives import (
    Actor,
    Critic,
    NetworkConfig,
    Primitive,
    PrimitiveConfig,
    cross_entropy,
    encode,
)
from knotflow.samplers.primitives.distribution import Gaussian
from knotflow.simulation import (
    LEVELS,
    SPLINE_HIGH,
    SPLINE_LOW,
    Attempts,
    Rollouts,
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    StartsConfig,
    Trials,
    arc,
    is_roomy,
    perturb_rope,
    random_curve,
    resample,
    straight,
)
from knotflow.simulation.worlds import EXPONENTS
from knotflow.topology import (
    Action,
    TopologicalState,
    knot,
    parse_action,
    segment_intervals,
    solution_graph,
)
from knotflow.topology.draw import draw
from knotflow.training import Learner, LearnerConfig
from knotflow.training.learner import actor_loss, critic_loss, demonstration_buffer
from knotflow.training.trainer import SupervisedTrainer
from knotflow.versions import COMPONENTS
from knotflow.workflow.dependencies import ROOT, component_of, component_versions

FOLDER = Path(__file__).parent / "golden"
ATOL = 1e-4  # metres, network units, logits
YOUNG = 0.5  # seconds of a rollout before strands touch
ROPE = RopeConfig()
SPLINES = np.array(
    [
        [0.1, -0.2, 0.2, 0.15, 0.1, -0.1],
        [0.5, 0.0, 0.2, 0.1, 0.1, 0.15],
        [0.95, 0.2, 0.2, 0.2, -0.1, 0.1],
    ]
)
LOOP_ACTIONS = ["C(0,1,1)", "C(1,2,1)", "R1(0,1,1)"]  # one each of primitives 3, 4 and 1


def loop() -> np.ndarray:
    """A rope (V, 3) with the loop of R1(0,1,1), metres."""
    along = np.linspace(0, 1, 200)
    heading = 0.3 + 2 * np.pi * np.clip((along - 0.3) / 0.4, 0, 1) + 0.4 * np.sin(9 * along)
    curve = np.cumsum(np.stack([np.cos(heading), np.sin(heading), 0 * heading], 1), 0) / 200
    curve[:, 2] = 0.008 + 0.016 * np.exp(-(((along - 0.7) / 0.05) ** 2))
    curve[:, :2] -= curve[:, :2].mean(0)
    return resample(curve, ROPE)


def topology() -> dict[str, Any]:
    """States read off curves, what actions make of them, and the ways to the named knots."""
    state = TopologicalState.from_curve(loop())
    steps = [[str(action), str(after)] for action, after in state.actions()]
    graphs = [
        [name, *sorted([graph.number_of_nodes(), graph.number_of_edges()] for graph in graphs)]
        for name in ("figure_eight", "overhand", "pentagram", "three_twist", "unknot")
        for graphs in [[solution_graph(one) for one in knot(name)]]
    ]
    return {
        "state": str(state),
        "actions": sorted(steps),
        "segments": segment_intervals(loop()),
        "graphs": graphs,
    }


def simulation() -> dict[str, Any]:
    """Young rollouts of three splines, and start shapes."""
    rollouts = RopeSimulator(SimulationConfig(threads=1)).execute(
        np.stack([straight(ROPE)] * len(SPLINES)), SPLINES
    )
    young = rollouts.times <= YOUNG + 1e-9
    curves = [random_curve(ROPE, np.random.default_rng(seed), StartsConfig()) for seed in (0, 1)]
    perturbed = [perturb_rope(ROPE, level, np.random.default_rng(0)) for level in LEVELS]
    return {
        "times": rollouts.times,
        "ropes": rollouts.trajectory[:, young, ::5],
        "gripper": rollouts.gripper[:, young],
        "arc": arc(ROPE)[::5],
        "random_curves": [curve[::5] for curve in curves],
        "is_roomy": [float(is_roomy(loop(), ROPE, StartsConfig()))],
        "perturbed": [[getattr(one, name) for name in EXPONENTS] for one in perturbed],
    }


def demonstrations() -> dict[str, Any]:
    """The tasks, aimed guesses, and noisy copies of a spline."""
    rng = np.random.default_rng(0)
    return {
        "tasks": [[str(task.action), str(task.start_state)] for task in TASKS],
        "guesses": [
            heuristic_splines(loop(), parse_action(action), 3, rng) for action in LOOP_ACTIONS
        ],
        "copies": noisy_copies(SPLINES[0], 3, rng, NoiseConfig()),
        "predicted": [screened_splines(loop(), parse_action(one), 3, rng) for one in LOOP_ACTIONS],
    }


def baselines() -> dict[str, Any]:
    """Random splines, and one rope aligned with another."""
    motion, distance = align(arc(ROPE), random_curve(ROPE, np.random.default_rng(0)))
    action = parse_action("R1(0,1,1)")
    return {
        "random": RandomSampler().sample(loop(), action, 3, np.random.default_rng(0)),
        "motion": motion,
        "distance": [distance],
    }


def causal_infogan() -> dict[str, Any]:
    """A rope in its frame, and the measures of a plan from one rope to another."""
    start, end = straight(ROPE), arc(ROPE)
    way_points = start + np.linspace(0, 1, 4)[:, None, None] * (end - start)
    measures = measure(start, way_points[0] + 0.01, way_points, way_points[-1], end)
    return {
        "shape": StartFrame.of(loop()[None]).enter(loop()[None])[0, ::5],
        "measures": [*vars(measures).values()],
    }


def filled(network: torch.nn.Module) -> Any:
    """The network with weights that are the same everywhere."""
    with torch.no_grad():
        for number, weights in enumerate(network.parameters()):
            along = torch.arange(weights.numel(), dtype=torch.float64)
            weights.copy_((0.2 * torch.sin(along + number)).reshape(weights.shape))
    return network.eval()


SMALL = NetworkConfig(lstm=8, attention=4, stream=8, feature=8, head=8)


def primitives() -> dict[str, Any]:
    """Encoded ropes, what networks of given weights make of them, and a search."""
    encoded = encode([loop()] * len(LOOP_ACTIONS), [parse_action(one) for one in LOOP_ACTIONS])
    owner, splines = torch.arange(3), torch.linspace(-1, 1, 18).reshape(3, 6)
    with torch.no_grad():
        policy = filled(Actor(SMALL))(encoded.states)
        logits = filled(Critic(SMALL))(encoded.states, splines, owner)
    noise = np.random.default_rng(0).standard_normal((3, 3, 16, 6), dtype=np.float32)
    search = (
        lambda some: -(some - splines[:, None]).square().sum(-1),
        Gaussian(torch.zeros(3, 6), torch.eye(6).expand(3, 6, 6)),
        torch.from_numpy(noise),
        4,
    )
    found, value = cross_entropy(*search)
    return {
        "streams": encoded.states["streams"][:, ::4],
        "grasp": encoded.states["grasp"],
        "splines": encoded.frames.to_world(splines[:, None].double().numpy()),
        "actor_mean": policy.mean,
        "actor_factor": policy.factor,
        "critic": logits,
        "search": found,
        "search_value": value,
        "search_best": cross_entropy(*search, returns="best")[1],
    }


def training() -> dict[str, Any]:
    """Losses of networks of given weights on a made-up batch, and of a learner that settles."""
    states = encode([loop()] * 2, [parse_action(one) for one in LOOP_ACTIONS[:2]]).states
    batch = TensorDict(
        {
            "states": states,
            "spline": torch.linspace(-1, 1, 24).reshape(4, 6),
            "owner": torch.tensor([0, 0, 1, 1]),
            "reward": torch.tensor([1.0, 0.0, 0.0, 1.0]),
            "next_value": torch.tensor([0.0, 0.5, 0.2, 0.3]),
            "baseline": torch.tensor([0.5, 0.5, 0.2, 0.2]),
            "weight": torch.ones(4),
        }
    )
    losses = critic_loss(filled(Critic(SMALL)), batch) | actor_loss(
        filled(Actor(SMALL)), batch, LearnerConfig(failure_weight=0.5)
    )
    return losses | {f"settling_{name}": value for name, value in after_reset().items()}


def after_reset() -> dict[str, float]:
    """What three gradient steps on made-up trials give, after the critic was reset."""
    action, rng = parse_action("R1(0,1,1)"), np.random.default_rng(0)
    curves = np.stack([straight(ROPE), arc(ROPE)])
    frames = encode(curves, [action] * len(curves)).frames
    splines, trivial = frames.to_world(rng.normal(0.0, 0.6, (2, 8, 6))), TopologicalState.trivial()
    made_up = [
        Trials(action, trivial, np.stack([curve] * 8), own, own[:, 5] > 0)
        for curve, own in zip(curves, splines, strict=True)
    ]
    learner = Learner(Primitive(PrimitiveConfig(network=SMALL)), LearnerConfig(), seed=0)
    filled(learner.primitive).train()
    learner.demonstrations = demonstration_buffer(made_up, learner.generator)
    return learner.fit(3, reset=True)


class Obedient:
    """Sampler and simulator in one: one in so many of its splines does what its action says, and
    the others change nothing."""

    config = SimulationConfig(rope=RopeConfig(links=120, radius=0.004))

    def __init__(self, every: int = 3) -> None:
        self.every = every
        self.ends: dict[bytes, np.ndarray] = {}

    def sample(
        self, points: np.ndarray, action: Action, count: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Random splines (count, 6)."""
        state = TopologicalState.from_curve(points).apply(action)
        splines = rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))
        for spline in splines:
            does = len(self.ends) % self.every == self.every - 1
            self.ends[spline.tobytes()] = self.shape(state) if does else points
        return splines

    def shape(self, state: TopologicalState) -> np.ndarray:
        """A rope (V, 3) in a state."""
        rope = self.config.rope
        return resample(draw(state, gap=2 * rope.radius), rope) + [0, 0, rope.radius]

    def execute(self, points: np.ndarray, splines: np.ndarray) -> Rollouts:
        """Ropes that are there at once; a guess, which nobody sampled, changes nothing."""
        ends = np.stack(
            [self.ends.get(one.tobytes(), rope) for rope, one in zip(points, splines, strict=True)]
        )
        frames = np.stack([points, ends], 1).astype(np.float32)
        unharmed = np.zeros(len(ends), bool)
        return Rollouts(
            np.array([0.0, 1.0]),
            frames,
            frames[:, :, 0],
            np.full(len(ends), 2),
            np.ones(len(ends)),
            ends,
            unharmed,
        )


def searched(rule: str, state: TopologicalState | None = None) -> list[Any]:
    """What a search tries, and what it finds, from a straight rope, or where it hardly gets on."""
    world = Obedient(every=30 if state else 3)
    start = world.shape(state) if state else straight(world.config.rope)
    config = PlannerConfig(rule=rule, batch=4, max_branches=40)
    goal, rng = parse_goal("overhand"), np.random.default_rng(0)
    plan = plan_knot(start, goal, world, world, rng, config)
    tried = [
        [str(one.state), str(one.action), one.outcome, one.success, one.branches]
        for one in plan.tried
    ]
    return [plan.branches, plan.kept, [str(action) for action in plan.actions], sorted(tried)]


def planning() -> dict[str, Any]:
    """Distances in a solution DAG, where a tree would grow, and searches."""
    dag = SolutionDag.to(*knot("overhand"))
    state, nodes, steps = TopologicalState.trivial(), [], []
    for text in ("R1(0,1,1)", "C(0,1,1)", "C(2,0,1)"):
        edges = dag.edges_from(state)
        steps.append([str(state), dag.distance(state), len(edges)])
        nodes.append(Node(loop(), state, dag.distance(state), edges))
        state = state.apply(parse_action(text))
    rule = PosteriorRule(PlannerConfig(), dag)
    for node in nodes:
        rule.add(node)
    branches = [[str(one.node.state), str(one.action)] for one in rule.choose(12)]
    return {
        "dag": steps,
        "probabilities": node_probabilities([node.distance for node in nodes]),
        "branches": branches,
        "searches": [searched(rule) for rule in RULES],
        "onward": [searched(rule, nodes[-1].state) for rule in RULES],
    }


def perception() -> dict[str, Any]:
    """A noisy image of a held rope, what its pixels are taken for, and a rope estimated at rest."""
    camera, rng = Camera.overhead(), np.random.default_rng(0)
    noise, rope = CameraNoiseConfig(), RopeConfig(radius=0.008)
    simulated = SimulatedCamera(camera, rope, noise, Appearance.draw(rng, noise))
    view = simulated.view(loop(), gripper=loop()[5])
    image = add_noise(view.image, camera, noise, rng)
    labels = (view.labels, segment(image, camera, rope.radius).labels)
    at_rest = SimulatedCamera(camera, ROPE, noise, Appearance.draw(rng, noise))
    found = estimate(at_rest.capture(loop(), rng), camera, ROPE, likely=[loop()])
    return {
        "estimate": found.points[::10],
        "explained": [found.coverage_fraction, found.seen_radius],
        "depth": view.image.depth[::60, ::80],
        "noise": [np.isnan(image.depth).mean(), np.nanstd(image.depth - view.image.depth)],
        "colour": image.rgb.reshape(-1, 3).mean(0) / 255,
        "shares": [np.bincount(one.ravel(), minlength=4) / one.size for one in labels],
    }


def crossings() -> dict[str, Any]:
    """A crossing that is the wrong way round, turned, and how far the shape moves."""
    camera, rng = Camera.overhead(distance=0.8), np.random.default_rng(0)
    noise, rope = CameraNoiseConfig(), RopeConfig(radius=0.0025)
    image = SimulatedCamera(camera, rope, noise).capture(loop(), rng)
    (pair,) = crossing_fractions(loop())
    guess = exchange_heights(loop(), *pair, rope)
    shape, found = score_crossings(guess, observe(image, camera, rope))
    return {
        "shape": [np.abs(shape - guess).max(), np.abs(shape - loop()).max()],
        "crossings": [[*one.fractions, one.first_over, one.gap, one.certainty] for one in found],
    }


def tracking() -> dict[str, Any]:
    """A rope followed by a few gradient steps, and by more where it has moved farther."""
    camera, rng, noise = (
        Camera.overhead(distance=0.8),
        np.random.default_rng(0),
        CameraNoiseConfig(),
    )
    simulated = SimulatedCamera(camera, ROPE, noise, Appearance.draw(rng, noise))
    ropes = [loop() + [moved, 0.0, 0.0] for moved in (0.004, 0.032)]
    images = [simulated.capture(rope, rng) for rope in ropes]
    trackers = [Tracker(camera, ROPE, loop(), lambda points, *_: points) for _ in images]
    found = [one.update(image) for one, image in zip(trackers, images, strict=True)]
    # To a millimetre and half a per cent: BLAS's kernels for other processors differ by 0.7 mm and
    # 0.1 per cent.
    return {
        "points": [0.1 * one.points[::10] for one in found],
        "explained": [0.02 * one.coverage_fraction for one in found],
    }


def twin() -> dict[str, Any]:
    """A rope and a gripper that differ from the nominal ones, and where the gripper gets to."""
    made = Twin(arc(ROPE), TwinConfig(), np.random.default_rng(0))
    robot = made.robot()
    robot.move_to(np.array([0.1, 0.0, 0.2]), 0.3)
    return {
        "rope": [1e3 * made.rope.radius, made.rope.density, 1e3 * made.rope.joint_stiffness],
        "gripper": robot.position,
        "compute_time": made.config.compute_time,
    }


def execution() -> dict[str, Any]:
    """What robots do wrong, the path of a gripper that begins beside its plan, and what a network
    of given weights makes of dragged ropes."""
    times = np.linspace(0.0, 1.8, 7)
    path = np.linspace([0.0, 0.0, 0.008], [0.3, 0.1, 0.008], 7)
    step = SimpleNamespace(times=times, gripper=path, release_time=1.8)
    ropes = torch.from_numpy(np.stack([loop(), arc(ROPE)])).float()
    drag = torch.tensor([[0.02, 0.0, 0.01], [0.04, 0.0, 0.0]]) + ropes[:, 10:11]
    dynamics = filled(LstmDynamics(LstmConfig(hidden=8)))
    with torch.no_grad():
        ahead = dynamics.predict(ropes, 0.1 * ropes, torch.tensor([10, FREE]), drag)
    return {
        "errors": [list(vars(one).values()) for one in ERROR_LEVELS],
        "path": path_from_grasp(cast(PlanStep, step), np.array([0.02, -0.01, 0.008])),
        "dragged": ahead[:, :, ::5],
    }


def control() -> dict[str, Any]:
    """How a controller corrects a drag."""
    frames, weights = np.linspace(loop(), loop() + [0.06, 0.02, 0.0], 7), np.linspace(1, 2, 41)
    mppi = Mppi(filled(LstmDynamics(LstmConfig(hidden=8))), MppiConfig(samples=8))
    mppi.begin(frames, frames[:, 5] + [0.0, 0.0, 0.01], weights, 5)
    aside = frames[:2] + [0.0, 0.01, 0.0]
    return {"acted": [mppi.act(rope, 0.0 * rope, rope[5] + [0.01, 0.0, 0.0]) for rope in aside]}


def export() -> dict[str, Any]:
    """When an arm is where, on a path that turns back faster than it can."""
    turn = np.linspace(0.0, 1.5 * np.pi, 12)[:, None]
    joints = panda().homes[0] + 0.4 * np.sin(turn) * np.linspace(0.2, 1.0, 7)
    curve = keep_limits(panda(), joints, np.full(11, 0.05))
    return {"times": curve.x, "rates": curve(curve.x, 1)}


def recording() -> dict[str, Any]:
    """A rollout that was written and read back."""
    action, before = parse_action("C(0,1,1)"), TopologicalState.from_curve(loop())
    frames = np.linspace(loop(), loop() + [0.1, 0.0, 0.0], 3, dtype=np.float32)[None]
    gripper, ends = frames[:, :, 5] + np.float32(0.01), frames[:, -1].astype(float)
    rollouts = Rollouts(
        np.array([0.0, 0.1, 0.25]),
        frames,
        gripper,
        np.array([3]),
        np.array([0.2]),
        ends,
        np.zeros(1, bool),
    )
    attempts = Attempts.of(action, before, loop()[None], SPLINES[:1], rollouts)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "one.mcap"
        made = recorded(attempts, ROPE, "golden", "0123", 7, {"seed": "1"})
        write_recording(path, made, {"stage": "golden"})
        (found,) = read_recording(path)
        table = load(path)
    return {
        "points": found.points[:, ::10],
        "gripper": found.gripper,
        "times": found.times,
        "spline": found.spline,
        "control_points": found.control_points,
        "texts": [found.action, found.start_state, found.goal_state, found.end_state],
        "outcome": [found.outcome, found.source, found.signature, dict(found.extra)["seed"]],
        "columns": [*table.columns],
        "row": [int(table.at[0, "number"]), float(table.at[0, "duration_s"])],
    }


class Line(SupervisedTrainer):
    """Fits y = 2 x + 1."""

    measure = "error"

    def update(self, step: int) -> float:
        x = torch.rand((8, 1), generator=self.generator)
        loss = ((self.model(x) - 2 * x - 1) ** 2).mean()
        self.descend(loss, (1 - self.fraction(step)) * self.effort.learning_rate)
        return float(loss.detach())


def trainer() -> dict[str, Any]:
    model = torch.nn.Linear(1, 1)
    torch.nn.init.zeros_(model.weight)
    torch.nn.init.zeros_(model.bias)
    effort = SimpleNamespace(
        validations=3, steps=4, learning_rate=0.1, weight_decay=0.01, gradient_norm=1.0
    )
    curve = [row["error"] for row in Line(model, effort, 0)]
    return {"curve": curve, "weights": torch.cat([model.weight[0], model.bias])}


CASES: dict[str, Callable[[], dict[str, Any]]] = {
    "topology": topology,
    "simulation": simulation,
    "demonstrations": demonstrations,
    "baselines": baselines,
    "causal_infogan": causal_infogan,
    "primitives": primitives,
    "trainer": trainer,
    "training": training,
    "planning": planning,
    "perception": perception,
    "crossings": crossings,
    "tracking": tracking,
    "execution": execution,
    "control": control,
    "twin": twin,
    "export": export,
    "recording": recording,
}


def computed(package: str) -> dict[str, Any]:
    """The outcomes of now as JSON holds them, numbers to six digits after the point."""
    return {name: _plain(value) for name, value in CASES[package]().items()}


def _plain(value: Any) -> Any:
    if isinstance(value, torch.Tensor):
        value = value.detach().numpy()
    if isinstance(value, np.ndarray | np.generic | float):
        value = np.round(np.asarray(value, np.float64), 6).tolist()
    return [_plain(item) for item in value] if isinstance(value, list) else value


def same(one: Any, other: Any) -> bool:
    """Whether two outcomes agree: text exactly, numbers within the tolerance."""
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return bool(np.isclose(one, other, rtol=0, atol=ATOL))
    return type(one) is type(other) and bool(one == other)


def changed(package: str, golden: dict[str, Any]) -> list[str]:
    """The outcomes that differ from the golden ones."""
    now, then = computed(package), golden["outcomes"]
    return [name for name in sorted({*now, *then}) if not same(now.get(name), then.get(name))]


def versions(package: str) -> dict[str, int]:
    """The versions of a package and of those it uses."""
    files = [file for file in ROOT.rglob("*.py") if file.name != "__init__.py"]
    names = (
        ".".join(("knotflow", *file.relative_to(ROOT).with_suffix("").parts)) for file in files
    )
    return component_versions(name for name in names if component_of(name) == package)


def read(package: str) -> dict[str, Any]:
    return dict(json.loads((FOLDER / f"{package}.json").read_text("utf-8")))


def test_every_package_has_golden_outcomes() -> None:
    assert CASES.keys() == COMPONENTS.keys()


@pytest.mark.parametrize("package", CASES)
def test_behaviour_is_that_of_the_version(package: str) -> None:
    golden, now = read(package), versions(package)
    write = f"write its golden file again: python tests/test_golden.py {package}"
    if golden["versions"] != now:
        pytest.fail(f"{package} and what it uses have versions {now}; {write}")
    if names := changed(package, golden):
        pytest.fail(
            f"{package} computes other {', '.join(names)} than its version {now[package]} did. If "
            f"that is meant, raise its number in src/knotflow/versions.py, then {write}"
        )


def test_other_outcomes_are_noticed() -> None:
    assert same([[1.0, "a"]], [[1.00001, "a"]])
    for other in ([[1.001, "a"]], [[1.0, "b"]], [[1.0]], None, [["a", "a"]], [[float("nan"), "a"]]):
        assert not same([[1.0, "a"]], other) and not same(other, [[1.0, "a"]])


def main(packages: list[str]) -> None:
    """Write golden files, but none whose outcomes changed under the same version."""
    for package in packages or CASES:
        path, now = FOLDER / f"{package}.json", versions(package)
        known: dict[str, Any] = {}
        if path.exists() and read(package)["versions"] == now:
            names = changed(package, read(package))
            known = read(package)["outcomes"]
            if names and known.keys() & names:
                sys.exit(
                    f"error: {package} computes other {', '.join(known.keys() & names)}; raise its "
                    "number in src/knotflow/versions.py first"
                )
            if not names:
                continue
        outcomes = (computed(package) | known).items()
        lines = [f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in outcomes]
        text = ",\n".join(lines)
        path.parent.mkdir(exist_ok=True)
        head = f'"versions": {json.dumps(now)},\n'
        path.write_text(f'{{{head}"outcomes": {{\n{text}\n}}}}\n', "utf-8")
        print(f"wrote {path}")


if __name__ == "__main__":
    main(sys.argv[1:])

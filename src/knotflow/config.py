"""The typed configuration: one dataclass a package, registered with Hydra's ConfigStore.

The packages' own dataclasses say what their values mean. The ones here hold what belongs to an
experiment as a whole: counts that a budget sets, and seeds. Workflows hand each stage the part it
needs. What is set here has no default in the stage that takes it, so that it stands in one place.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import II, MISSING, DictConfig, OmegaConf

from knotflow.execution import DynamicsTrainingConfig, ExecutionConfig
from knotflow.execution.control.dynamics import SHIPPED_DYNAMICS
from knotflow.perception.training_config import (
    SELF_SUPERVISION_STEPS,
    SHIPPED_NETWORK,
    StrandTrainingConfig,
    TrainingConfig,
)
from knotflow.planning import FAST_SEARCH, PlannerConfig, plan_name
from knotflow.samplers import IcpConfig
from knotflow.samplers.causal_infogan import CausalInfoGanBudget
from knotflow.samplers.demonstrations import SHIPPED, DemonstratorConfig, NoiseConfig
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveConfig
from knotflow.simulation import SimulationConfig, StartsConfig
from knotflow.training import ImitationConfig, ReinforcementConfig, SelfPlayConfig
from knotflow.workflow import WorkersConfig


@dataclass
class DemonstrationsBudget:
    """The demonstrations that are copied, and how often."""

    file: str = str(SHIPPED)
    """JSON lines; yours may hold human demonstrations beside the shipped ones."""
    copies: int = 320
    """Noisy copies of a demonstration from a tangled start."""
    copies_untangled: int = 480
    """Noisy copies of a demonstration from an untangled start."""
    seed: int = 2
    """Of the noise."""


@dataclass
class EvaluationBudget:
    """Unseen starts and trials; their seeds are used for nothing else."""

    starts: int = 50
    """Starts of each action."""
    trials_per_start: int = 8
    """Splines sampled for each start: 400 rollouts a bar at budget=paper."""
    arranging: int = PlannerConfig.arranging
    """Most arranging splines of a trial by the method that arranges."""
    starts_seed: int = 1_000_003
    """Of the evaluation starts."""
    seed: int = 3
    """Of the sampling."""


@dataclass
class TrainingBudget:
    """The primitives: what they are made of, and how long they train."""

    primitive: PrimitiveConfig = field(default_factory=PrimitiveConfig)
    """Networks and search; its `variant` is the workflow's business."""
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    """Learning from demonstrations."""
    reinforcement: ReinforcementConfig = field(default_factory=ReinforcementConfig)
    """Learning from attempts."""
    pool: int = 768
    """Start shapes of each start state that reinforcement draws from."""
    seed: int = 10
    """Of weights, batches and attempts."""


ROUNDS = 8
"""Splines that move a rope, one after the other, whose shapes perception sees."""
SPARING_SEARCH = PlannerConfig(
    rule="paper", bias=100.0, failure_discount=0.5, max_branches=500, max_seconds=3600.0
)
"""One branch after the other (Sec. V-B d), straight on towards the goal, but soon elsewhere where
nothing succeeds, such as at loops that are too tight. What counts is the number of branches."""


@dataclass
class PlansBudget:
    """Searches for knots."""

    seeds: int = 10
    """Searches of each goal and start."""
    seed: int = 20
    """Of the random ropes and of the searches."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """How a tree grows, and when it is given up."""


@dataclass
class TreeSizeBudget(PlansBudget):
    """Searches for the overhand along one path, and how often each of its actions succeeds."""

    planner: PlannerConfig = field(default_factory=lambda: replace(SPARING_SEARCH))
    """How a tree grows, and when it is given up."""
    shapes: int = 24
    """Ropes from which each action is tried, ends of the action before."""
    splines: int = 8
    """Tried from each of them."""


@dataclass
class SelfPlayBudget:
    """All actions learned together (Sec. V-B c, and beyond)."""

    training: SelfPlayConfig = field(default_factory=SelfPlayConfig)
    """Learning from self-play."""
    seed: int = 40
    """Of the trials and batches; searches have ropes of their own."""


def _longer() -> SelfPlayConfig:
    """More often from one and two crossings: what leads on from there decides most searches. With
    4 in place of 2 parts from three crossings, and 200 rounds, 21 of 30 goals of three crossings
    that were set aside for development were tied in 400 branches, with these 25."""
    shares = [0.5, 3.0, 7.0, 2.0, 0.2]
    return SelfPlayConfig(
        rounds=250,
        crossings_shares=shares,
        capacity=60_000,
        critic_reset_every=125,
        critic_reset_steps=1500,
    )


@dataclass
class LibraryTrainingBudget:
    """Primitives for longer: self-play that goes on where joint finetuning ended."""

    begin: str = "results/joint_finetuning/primitives"
    """A library's file, or a folder of files: what it begins with."""
    training: SelfPlayConfig = field(default_factory=_longer)
    """Learning from self-play; of earlier attempts there are none."""
    seed: int = 46
    """Of the trials and batches; searches have ropes of their own."""


@dataclass
class JointBudget:
    """The searches that measure what learning together brings (Sec. VII-B2)."""

    plans: PlansBudget = field(
        default_factory=lambda: PlansBudget(seeds=50, seed=41, planner=SPARING_SEARCH)
    )
    """Searches from random ropes, before and after."""
    posterior: PlannerConfig = field(
        default_factory=lambda: PlannerConfig(max_branches=500, max_seconds=3600.0)
    )
    """How a tree grows from the same ropes by the rule that is not the paper's."""


@dataclass
class GoalsBudget:
    """States drawn at random among all of three and of four crossings."""

    three: int = 60
    """Goals of three crossings."""
    four: int = 40
    """Goals of four crossings."""
    seed: int = 2_000_003
    """Of goals, ropes and searches; used for nothing else."""
    planner: PlannerConfig = field(default_factory=lambda: replace(FAST_SEARCH))
    """How a tree grows, and when it is given up."""


@dataclass
class GoalsAblationBudget:
    """What each part of planning brings on random goals."""

    three: int = 20
    """Goals of three crossings, the first of those of `goals`."""
    four: int = 10
    """Goals of four crossings, the first of those of `goals`."""


@dataclass
class ActionsBudget:
    """All actions that lead to at most three crossings."""

    count: int = 10
    """Start shapes in each state, and trials of each action."""
    seed: int = 3_000_017
    """Of start shapes and trials; used for nothing else."""
    planner: PlannerConfig = field(default_factory=lambda: replace(FAST_SEARCH, max_seconds=20.0))
    """The search that ties the start shapes."""


@dataclass
class DynamicsBudget:
    """The motions by which models of a rope are judged (Sec. VI)."""

    weights: str = str(SHIPPED_DYNAMICS)
    """File of the learned dynamics; yours may take its place."""
    ropes: int = 60
    """Perturbed ropes, levels in turn."""
    per_rope: int = 16
    """Motions of each."""
    seed: int = 4_000_037
    """Of ropes and motions; used for nothing else."""


@dataclass
class DynamicsTrainingBudget:
    """The network that predicts dragged ropes."""

    ropes: int = 600
    """Perturbed ropes whose motions are learned from, levels in turn."""
    per_rope: int = 16
    """Motions of each."""
    training: DynamicsTrainingConfig = field(default_factory=DynamicsTrainingConfig)
    """Learning from these motions."""
    seed: int = 4_200_013
    """Of ropes, motions, weights and batches; used for nothing else."""


@dataclass
class ClosedLoopBudget:
    """Plans executed on perturbed twins (Sec. VI)."""

    twins: int = 50
    """Twins of levels 0 and 2, and those of a yardstick that knows the true state."""
    twins_level_1: int = 100
    """Twins of level 1."""
    yardsticks: int = 10
    """Twins of level 1 on which MPPI predicts by simulating, which takes a second a tick."""
    figure_eight: int = 30
    """Twins of level 1 on which a figure eight is tied."""
    faults: int = 10
    """Twins of level 1 with each fault of robot or camera."""
    ensemble: int = 8
    """Perturbed ropes that judge the plans that are to be robust."""
    seed: int = 5_500_003
    """Of ropes, plans and twins; used for nothing else."""
    planner: PlannerConfig = field(default_factory=lambda: replace(FAST_SEARCH, margin=0.05))
    """How a tree grows, and when it is given up."""
    execution: ExecutionConfig = field(default_factory=ExecutionConfig)
    """Heights, speeds, and when an execution is given up."""


@dataclass
class ArmBudget:
    """Plans that an arm follows."""

    plans: int = 50
    """From a random rope each."""
    max_speed: float = 0.25
    """Of the tip, metres per second."""
    seed: int = 5_100_019
    """Of ropes and plans; used for nothing else."""
    planner: PlannerConfig = field(default_factory=lambda: replace(FAST_SEARCH))
    """How a tree grows, and when it is given up."""


@dataclass
class PentagramBudget:
    """The pentagram, with and without a hand that helps (Sec. VII-E)."""

    ropes: int = 4
    """Ropes whose head is pulled out, of which one is taken."""
    tied_by: str = "primitives"
    """The sampler that ties them."""
    pulled: PlansBudget = field(default_factory=lambda: PlansBudget(planner=SPARING_SEARCH))
    """Searches from the overhand whose head was pulled out."""
    untangled: PlansBudget = field(
        default_factory=lambda: PlansBudget(planner=replace(FAST_SEARCH, max_seconds=120.0))
    )
    """Searches with no hand's help, from overhands as the planner leaves them and from a straight
    rope; by its planner the pulled rope is searched from, too."""


@dataclass
class PlanRequest:
    """What +experiment=overhand plans; `knot=...` is short for `plan.knot=...`, and so on."""

    knot: str = "overhand"
    """What is tied: a name, crossings, or a topological path."""
    rope: str = "random"
    """The rope it is tied into: straight, arc, random, or a CSV or NPY file of (V, 3) metres."""
    seed: int = 0
    """Of that rope and of the search."""
    sampler: str = "primitives"
    """Who proposes splines where one plans: primitives (trained), or aimed (not learned)."""
    primitives: str = "${shipped_primitives:}"
    """Its library: a file, or a folder such as yours in results/joint_finetuning/primitives."""
    planner: PlannerConfig = field(default_factory=lambda: replace(FAST_SEARCH))
    """How the tree grows, and when it is given up."""


@dataclass
class BenchmarkBudget:
    """What the benchmark spends."""

    rollouts: int = 512
    """Random splines in each case."""
    backends: list[str] = field(default_factory=lambda: ["loky", "ray"])
    """Kinds of workers of which two are timed, beside one."""
    run: int = 0
    """Raise it to time again on the same results folder."""


@dataclass
class RootsBudget:
    """What the comparison of roots spends."""

    rollouts: int = 500
    """Random splines, and as many aimed ones, whose ends are compared between roots."""
    trials: int = 160
    """Splines of each action whose success is compared between roots."""


@dataclass
class AdaptationBudget:
    """The images from which the network that sees ropes learns without their shapes."""

    shards: int = 2
    """Of 32 ropes, among whose shapes those in the images are chosen."""
    rounds: int = ROUNDS
    """Splines that each of these is moved by, one after the other."""
    images: int = 64
    """Of one rope each."""
    steps: int = SELF_SUPERVISION_STEPS
    """Gradient steps."""
    seed: int = 4_600_019
    """Of ropes, noise and batches; used for nothing else."""


@dataclass
class PerceptionBudget:
    """The ropes that are estimated from one image each (Sec. VI)."""

    shards: int = 24
    """Of 32 ropes, among whose shapes ropes are chosen."""
    rounds: int = ROUNDS
    """Splines that each of these is moved by, one after the other."""
    ropes: int = 12
    """Ropes of each number of crossings."""
    crossings: list[int] = field(default_factory=lambda: [0, 1, 2, 3, 4, 5])
    """Numbers of crossings."""
    levels: list[float] = field(default_factory=lambda: [0.0, 1.0, 2.0])
    """Of the camera's noise; 1 is nominal."""
    seed: int = 4_800_007
    """Of ropes and noise; used for nothing else."""
    network: str = str(SHIPPED_NETWORK)
    """File of the network's weights; yours may take its place."""
    adaptation: AdaptationBudget = field(default_factory=AdaptationBudget)
    """Its learning from images alone."""
    planned: int = 20
    """Random ropes from whose estimates, and true shapes, the overhand is planned."""
    planner: PlannerConfig = field(default_factory=lambda: replace(FAST_SEARCH))
    """How these plans are searched for."""


@dataclass
class TrackingBudget:
    """The rollouts that are followed image by image (Sec. VI)."""

    levels: list[int] = field(default_factory=lambda: [0, 1, 2])
    """How far the ropes are from the planner's."""
    rollouts: int = 5
    """Of each action at each level."""
    seed: int = 5_000_011
    """Of ropes, cameras and noise; used for nothing else."""


@dataclass
class PerceptionTrainingBudget:
    """The networks that see ropes."""

    shards: int = 100
    """Of 32 ropes, whose shapes are learned from."""
    rounds: int = ROUNDS
    """Splines that each of these is moved by, one after the other."""
    training: TrainingConfig = field(default_factory=TrainingConfig)
    """Learning to see a whole rope, from drawings of these shapes."""
    strands: StrandTrainingConfig = field(default_factory=StrandTrainingConfig)
    """Learning to follow strands, from windows along them."""
    seed: int = 4_500_007
    """Of shapes, weights and drawings; used for nothing else."""


@dataclass
class Config:
    """Everything that `python -m knotflow` takes as `key=value`."""

    experiment: str = MISSING
    """Set by +experiment=NAME; the name of the results folder."""
    budget: str = MISSING
    """Set by budget=paper|smoke."""
    experiments: list[str] = field(default_factory=list)
    """Those that +experiment=paper runs one after the other; it has no workflow of its own."""
    results_dir: str = "results"
    """Where results/<experiment>/ and results/stages/ are."""
    results_name: str = "${experiment}"
    """Name of the results folder; the jobs of a sweep need one each."""
    overwrite: bool = False
    """Replace the results of another configuration."""
    metrics: str = "csv+tensorboard"
    """Loggers of training curves: csv, tensorboard, csv+tensorboard, mlflow, wandb or none."""
    workers: WorkersConfig = field(default_factory=WorkersConfig)
    """Where stages run their shards: the cores of this machine, or a Ray cluster."""
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    starts: StartsConfig = field(default_factory=StartsConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    demonstrations: DemonstrationsBudget = field(default_factory=DemonstrationsBudget)
    demonstrator: DemonstratorConfig = field(
        default_factory=lambda: DemonstratorConfig(noise=II("noise"))
    )
    """A demonstration has to bear the noise that its copies will have."""
    evaluation: EvaluationBudget = field(default_factory=EvaluationBudget)
    icp: IcpConfig = field(default_factory=IcpConfig)
    training: TrainingBudget = field(default_factory=TrainingBudget)
    benchmark: BenchmarkBudget = field(default_factory=BenchmarkBudget)
    roots: RootsBudget = field(default_factory=RootsBudget)
    causal_infogan: CausalInfoGanBudget = field(default_factory=CausalInfoGanBudget)
    tree_size: TreeSizeBudget = field(default_factory=TreeSizeBudget)
    """Trees for the overhand along one path."""
    self_play: SelfPlayBudget = field(default_factory=SelfPlayBudget)
    """Primitives trained together on all actions."""
    library_training: LibraryTrainingBudget = field(default_factory=LibraryTrainingBudget)
    """Primitives that go on learning all actions."""
    joint_finetuning: JointBudget = field(default_factory=JointBudget)
    """Searches for the overhand before and after."""
    pentagram: PentagramBudget = field(default_factory=PentagramBudget)
    knots: PlansBudget = field(default_factory=lambda: PlansBudget(seeds=20, planner=FAST_SEARCH))
    """Named knots from random ropes, and the overhand from tangled ones."""
    goals: GoalsBudget = field(default_factory=GoalsBudget)
    """Searches for states drawn at random."""
    goals_ablation: GoalsAblationBudget = field(default_factory=GoalsAblationBudget)
    """The same without one part."""
    actions: ActionsBudget = field(default_factory=ActionsBudget)
    """Trials of all actions."""
    perception_training: PerceptionTrainingBudget = field(default_factory=PerceptionTrainingBudget)
    """The network that sees ropes."""
    perception: PerceptionBudget = field(default_factory=PerceptionBudget)
    tracking: TrackingBudget = field(default_factory=TrackingBudget)
    dynamics_training: DynamicsTrainingBudget = field(default_factory=DynamicsTrainingBudget)
    """The network that predicts dragged ropes."""
    dynamics: DynamicsBudget = field(default_factory=DynamicsBudget)
    """Predictions of ropes that are dragged."""
    closed_loop: ClosedLoopBudget = field(default_factory=ClosedLoopBudget)
    """Executions on twins."""
    arm: ArmBudget = field(default_factory=ArmBudget)
    """Plans as joint trajectories."""
    plan: PlanRequest = field(default_factory=PlanRequest)
    workflow: dict[str, Any] = field(default_factory=dict)
    """The stages of the experiment, from workflows/."""


def digest(path: str) -> str:
    """Hash of a file's contents, 16 hex digits.

    Raises:
        FileNotFoundError: naming the path.
    """
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


def contents(text: str) -> str:
    """Hash of what is in the file or folder that a text names, or the text where it names none."""
    path = Path(text)
    if text and path.is_dir():
        return "-".join(digest(str(part)) for part in sorted(path.iterdir()) if part.is_file())
    return digest(text) if path.is_file() else text


def changed(node: DictConfig, changes: DictConfig) -> DictConfig:
    """A part of the configuration but for some of its values: `${changed:${planner},{batch:1}}`.

    Raises:
        ConfigKeyError, ValidationError: it has no such value.
    """
    merged = OmegaConf.merge(node, changes)
    assert isinstance(merged, DictConfig)
    return merged


def plan_folder(knot: str, rope: str, seed: int) -> str:
    """Where a plan's results are: "overhand" for the one of the report, else a folder of its own.

    So nobody who plans another knot is refused, and no plan replaces another.
    """
    if (knot, rope, seed) == (PlanRequest.knot, PlanRequest.rope, PlanRequest.seed):
        return "overhand"
    return f"plan-{plan_name(knot, rope, seed)}"


def shipped_primitives() -> str:
    """The trained library that comes with the package."""
    return str(SHIPPED_PRIMITIVES)


def register() -> None:
    """Make the schema and the resolvers known to Hydra."""
    ConfigStore.instance().store(name="schema", node=Config)
    for resolver in (changed, digest, contents, plan_folder, shipped_primitives):
        OmegaConf.register_new_resolver(resolver.__name__, resolver, replace=True)

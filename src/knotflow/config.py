"""The typed configuration: one dataclass a room, registered with Hydra's ConfigStore.

The rooms' own dataclasses say what their values mean. The ones here hold what belongs to an
experiment as a whole: counts that a budget sets, and seeds. Workflows hand each stage the part it
needs.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, OmegaConf

from knotflow.baselines import IcpConfig
from knotflow.baselines.causal_infogan import CausalInfoGanBudget
from knotflow.demonstrations import SHIPPED, NoiseConfig
from knotflow.primitives import PrimitiveConfig
from knotflow.simulation import SimulationConfig, StartsConfig
from knotflow.training import ImitationConfig, ReinforcementConfig
from knotflow.workflow.stages.provenance import Provenance


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
class DemonstratorBudget:
    """The effort of the scripted demonstrator."""

    starts_per_task: int = 8
    guesses: int = 128
    samples: int = 40
    iterations: int = 4
    least_share: float = 0.4
    seed: int = 1


@dataclass
class EvaluationBudget:
    """Unseen starts and trials; their seeds are used for nothing else."""

    starts: int = 50
    """Starts of each action."""
    trials_per_start: int = 8
    """Splines sampled for each start: 400 rollouts a bar at budget=paper."""
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
    pool: int = 192
    """Start shapes of each start state that reinforcement draws from."""
    seed: int = 10
    """Of weights, batches and attempts."""


@dataclass
class BenchmarkBudget:
    """What the benchmark spends."""

    rollouts: int = 512
    """Random splines in each case."""
    run: int = 0
    """Raise it to time again on the same results folder."""


@dataclass
class Config:
    """Everything that `python -m knotflow` takes as `key=value`."""

    experiment: str = MISSING
    """Set by +experiment=NAME; the name of the results folder."""
    budget: str = MISSING
    """Set by budget=paper|smoke."""
    results_dir: str = "results"
    """Where results/<experiment>/ and results/stages/ are."""
    overwrite: bool = False
    """Replace the results of another configuration."""
    metrics: str = "csv+tensorboard"
    """Loggers of training curves: csv, tensorboard, csv+tensorboard, mlflow or none."""
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    starts: StartsConfig = field(default_factory=StartsConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    demonstrations: DemonstrationsBudget = field(default_factory=DemonstrationsBudget)
    demonstrator: DemonstratorBudget = field(default_factory=DemonstratorBudget)
    evaluation: EvaluationBudget = field(default_factory=EvaluationBudget)
    icp: IcpConfig = field(default_factory=IcpConfig)
    training: TrainingBudget = field(default_factory=TrainingBudget)
    benchmark: BenchmarkBudget = field(default_factory=BenchmarkBudget)
    causal_infogan: CausalInfoGanBudget = field(default_factory=CausalInfoGanBudget)
    provenance: Provenance = field(default_factory=Provenance)
    """Filled in by the command."""
    workflow: dict[str, Any] = field(default_factory=dict)
    """The stages of the experiment, from workflows/."""


def digest(path: str) -> str:
    """Hash of a file's contents, 16 hex digits.

    Raises:
        FileNotFoundError: naming the path.
    """
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


def register() -> None:
    """Make the schema and the resolver `${digest:PATH}` known to Hydra."""
    ConfigStore.instance().store(name="schema", node=Config)
    OmegaConf.register_new_resolver("digest", digest, replace=True)

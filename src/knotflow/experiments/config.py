"""The root configuration of `python -m knotflow`, as Hydra composes it from conf/."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from hydra.core.config_store import ConfigStore
from omegaconf import II, MISSING

import knotflow
from knotflow.execution import SHIPPED_DYNAMICS, ExecutionConfig
from knotflow.perception import SHIPPED_NETWORK
from knotflow.planning import PlannerConfig, SurvivalConfig
from knotflow.samplers import SamplerConfig
from knotflow.samplers.demonstrations import SHIPPED, DemonstratorConfig, NoiseConfig
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveConfig
from knotflow.simulation import RopeConfig, SimulationConfig, StartsConfig
from knotflow.training import (
    ImitationConfig,
    JointConfig,
    KnotsConfig,
    ReinforcementConfig,
    SelfPlayConfig,
)
from knotflow.workflow import WorkersConfig

PACKAGE = Path(knotflow.__file__).parent
HOME = PACKAGE if (PACKAGE / "conf").is_dir() else PACKAGE.parents[1]
"""Holds conf/ and workflows/: inside an installed package, or at the top of a checkout."""


@dataclass
class Config:
    """Everything that `python -m knotflow` takes as `key=value`.

    Stages take what they need by name: typed parts such as `simulation`, files such as
    `primitives`, and numbers from the section called like the stage or the experiment.
    """

    experiment: str = "${workflow.name}"
    """Set by +experiment=NAME."""
    budget: str = MISSING
    """Name of the counts in use, set by budget=paper|afternoon|smoke."""
    results_dir: str = "results"
    """Where results/<experiment>/ and results/stages/ are."""
    results_name: str = "${experiment}"
    """Name of the results folder; the jobs of a sweep over values need one each."""
    workers: WorkersConfig = field(default_factory=WorkersConfig)
    """Where stages run their shards: the cores of this machine, or a Ray cluster."""

    demonstrations_file: str = str(SHIPPED)
    """Demonstrations (JSON lines), for example yours from the studio."""
    primitives: str = str(SHIPPED_PRIMITIVES)
    """The library that one plans with: a file, or a folder of files."""
    dynamics_weights: str = str(SHIPPED_DYNAMICS)
    """The learned rope dynamics."""
    network: str = str(SHIPPED_NETWORK)
    """The network that follows strands."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    simulation: SimulationConfig = field(default_factory=lambda: SimulationConfig(rope=II("rope")))
    starts: StartsConfig = field(default_factory=StartsConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    demonstrator: DemonstratorConfig = field(
        default_factory=lambda: DemonstratorConfig(noise=II("noise"))
    )
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    survival: SurvivalConfig = field(default_factory=SurvivalConfig)
    primitive: PrimitiveConfig = field(default_factory=PrimitiveConfig)
    imitation_training: ImitationConfig = field(default_factory=ImitationConfig)
    reinforcement_training: ReinforcementConfig = field(default_factory=ReinforcementConfig)
    joint_training: JointConfig = field(default_factory=JointConfig)
    self_play_training: SelfPlayConfig = field(default_factory=SelfPlayConfig)
    knots_training: KnotsConfig = field(default_factory=KnotsConfig)
    execution: ExecutionConfig = field(default_factory=ExecutionConfig)
    training_seed: int = MISSING
    """Of weights, batches and splines tried in training primitives."""
    training_seeds: list[int] = MISSING
    """Those of experiments that train several times."""

    workflow: dict[str, Any] = field(default_factory=dict)
    """The stages of the experiment, from workflows/."""


def register() -> None:
    """Make the schema, and where workflows/ is, known to Hydra."""
    os.environ["KNOTFLOW_HOME"] = str(HOME)
    if "schema.yaml" in (store := ConfigStore.instance()).list(""):
        return
    empty: list[Any] = [(name, dict[str, Any], field(default_factory=dict)) for name in sections()]
    store.store(name="schema", node=make_dataclass("Config", empty, bases=(Config,)))


@cache
def sections() -> tuple[str, ...]:
    """Stages, nodes and experiments to which a budget gives arguments, see `workflow.workflow`."""
    budgets = (HOME / "conf" / "budget").glob("*.yaml")
    names = {name for path in budgets for name in yaml.safe_load(path.read_text("utf-8"))}
    return tuple(sorted(names - {"defaults", *(one.name for one in fields(Config))}))


def experiments() -> list[str]:
    """Names of all experiments."""
    return sorted(path.stem for path in (HOME / "conf" / "experiment").glob("*.yaml"))

"""Stage `dynamics_training`: a network learns how ropes move with a gripper (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from knotflow.execution import DynamicsTrainer, DynamicsTrainingConfig, Motions
from knotflow.training.trainer import run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.motions import FILE as MOTIONS

FILE = "dynamics.safetensors"


@dataclass(kw_only=True)
class DynamicsTrainingStageConfig:
    """What learns, and how long."""

    training: DynamicsTrainingConfig = field(default_factory=DynamicsTrainingConfig)
    """The effort."""
    seed: int
    """Of weights and batches."""


@stage("dynamics_training", inputs=("motions",))
def train_dynamics(
    config: DynamicsTrainingStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes dynamics.safetensors, in half precision, and curves.csv; resumed by validation."""
    motions = Motions.load(inputs["motions"] / MOTIONS)
    training = DynamicsTrainer(motions, config.training, config.seed)

    def finish() -> None:
        with context.atomic(FILE) as path:
            training.model.save(path)

    run_training(
        training, context.out, name="dynamics", progress=context.progress, finish=finish,
        log=context.logger.log_scalar,
    )  # fmt: skip

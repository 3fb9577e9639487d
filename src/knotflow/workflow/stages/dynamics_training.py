"""Stage `dynamics_training`: a network learns how ropes move with a gripper (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from knotflow.execution import DynamicsTraining, DynamicsTrainingConfig, Motions
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.motions import FILE as MOTIONS

FILE = "dynamics.safetensors"
CHECKPOINT = "checkpoint.pt"


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
    training = DynamicsTraining(motions, config.training, config.seed)
    checkpoint = context.out / CHECKPOINT
    if checkpoint.exists():
        training.load(checkpoint)
    done = len(training.history)
    with context.progress(total=config.training.validations, initial=done, desc="dynamics") as bar:
        for metrics in training:
            for name, value in metrics.items():
                context.logger.log_scalar(name, value, len(training.history))
            with context.atomic(CHECKPOINT) as path:
                training.save(path)
            bar.update()
    with context.atomic("curves.csv") as path:
        curves = pd.DataFrame(training.history)
        curves.insert(0, "step", (curves.index + 1) * config.training.steps)
        curves.to_csv(path, index=False, float_format="%.6g")
    with context.atomic(FILE) as path:
        training.model.save(path)
    checkpoint.unlink(missing_ok=True)

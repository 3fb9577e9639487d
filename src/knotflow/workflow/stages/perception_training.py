"""Stage `perception_training`: a network learns to see simulated ropes (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from knotflow.perception.training import Training
from knotflow.perception.training_config import TrainingConfig
from knotflow.simulation import RopeConfig
from knotflow.training.trainer import run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.ropes import FILE as ROPES

FILE = "network.safetensors"


@dataclass(kw_only=True)
class PerceptionTrainingConfig:
    """What learns, and how long."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope of the shapes."""
    training: TrainingConfig = field(default_factory=TrainingConfig)
    """The effort."""
    seed: int
    """Of weights, examples and batches."""


@stage("perception_training", inputs=("ropes",))
def train_perception(
    config: PerceptionTrainingConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes network.safetensors, in half precision, and curves.csv; resumed by validation."""
    ropes = np.load(inputs["ropes"] / ROPES)
    training = Training(
        ropes["points"], ropes["crossings"], config.rope, config.training, config.seed
    )

    def finish() -> None:
        with context.atomic(FILE) as path:
            training.network.save(path)

    run_training(
        training, context.out, name="perception", progress=context.progress, finish=finish,
        log=context.logger.log_scalar,
    )  # fmt: skip

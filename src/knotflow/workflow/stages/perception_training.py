"""Stage `perception_training`: a network learns to see simulated ropes (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from knotflow.perception.training import Training
from knotflow.perception.training_config import TrainingConfig
from knotflow.simulation import RopeConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.ropes import FILE as ROPES

FILE = "network.safetensors"
CHECKPOINT = "checkpoint.pt"


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
    checkpoint = context.out / CHECKPOINT
    if checkpoint.exists():
        training.load(checkpoint)
    done = len(training.history)
    with context.progress(
        total=config.training.validations, initial=done, desc="perception"
    ) as bar:
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
        training.network.save(path)
    checkpoint.unlink(missing_ok=True)

"""Stage `strand_training`: a network learns to follow the strands of simulated ropes (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from knotflow.perception import Network, StrandTraining, StrandTrainingConfig
from knotflow.simulation import RopeConfig
from knotflow.training.trainer import run_training
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.perception_training import FILE
from knotflow.workflow.stages.ropes import FILE as ROPES


@dataclass(kw_only=True)
class StrandTrainingStageConfig:
    """What learns, how long, and beside which other network."""

    whole: str = runtime("")
    """File of the network that sees whole ropes; what counts is `whole_contents`."""
    whole_contents: str
    """Digest of what the file holds."""
    rope: RopeConfig = field(default_factory=RopeConfig)
    """The rope of the shapes."""
    training: StrandTrainingConfig = field(default_factory=StrandTrainingConfig)
    """The effort."""
    seed: int
    """Of weights, examples and batches."""


@stage("strand_training", inputs=("ropes",))
def train_strands(
    config: StrandTrainingStageConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes network.safetensors, of both networks, and curves.csv; resumed by validation.

    Raises:
        NetworkError: the file given is not a network that can be used.
    """
    whole = Network.load(config.whole)
    ropes = np.load(inputs["ropes"] / ROPES)
    training = StrandTraining(
        ropes["points"], ropes["crossings"], config.rope, config.training, config.seed
    )

    def finish() -> None:
        with context.atomic(FILE) as path:
            Network(whole.model, training.model).save(path)

    run_training(
        training, context.out, name="strands", progress=context.progress, finish=finish,
        log=context.logger.log_scalar,
    )  # fmt: skip

"""Stage `dynamics`: how far models of a rope are off on ropes they have not seen (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from knotflow.execution import (
    LstmDynamics,
    Motions,
    MujocoDynamics,
    RopeDynamics,
    StaticDynamics,
    prediction_errors,
)
from knotflow.simulation import SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.signature import runtime
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.motions import FILE as MOTIONS


@dataclass(kw_only=True)
class DynamicsConfig:
    """The models."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The planner's simulator, a model itself."""
    weights: str = runtime("")
    """File of the learned dynamics; what counts is `weights_contents`."""
    weights_contents: str
    """Digest of what the file holds."""


@stage("dynamics", inputs=("motions",))
def measure(config: DynamicsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes errors.csv, a row a model, level and number of steps."""
    models: dict[str, RopeDynamics] = {
        "still": StaticDynamics(),
        "lstm": LstmDynamics.load(Path(config.weights)),
        "mujoco": MujocoDynamics(config.simulation),
    }
    table = prediction_errors(models, Motions.load(inputs["motions"] / MOTIONS))
    with context.atomic("errors.csv") as path:
        table.to_csv(path, index=False)

"""Workflows: typed stages that run once, go on after an interruption, and share their outputs."""

from .chain import Experiment, run_all
from .context import StageContext
from .definition import StageNode, Workflow
from .errors import (
    DamagedStageError,
    DiskFullError,
    ForeignResultsError,
    UnknownStageError,
    WorkflowError,
)
from .metrics import Metrics, open_metrics
from .provenance import CodeState, code_state
from .runner import run
from .signature import runtime, signature
from .stage import Stage, get_stage, stage
from .workers import WorkersConfig

__all__ = [
    "CodeState",
    "DamagedStageError",
    "DiskFullError",
    "Experiment",
    "ForeignResultsError",
    "Metrics",
    "StageNode",
    "Stage",
    "StageContext",
    "UnknownStageError",
    "WorkersConfig",
    "Workflow",
    "WorkflowError",
    "code_state",
    "get_stage",
    "open_metrics",
    "run",
    "run_all",
    "runtime",
    "signature",
    "stage",
]

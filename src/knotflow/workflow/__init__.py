"""Workflows: typed stages that run once, resume after an interruption, and share their outputs."""

from knotflow.workflow.run import run_workflow
from knotflow.workflow.shards import StageRun, WorkersConfig
from knotflow.workflow.stage import Stage, WorkflowError, get_stage, stage
from knotflow.workflow.store import DamagedStageError
from knotflow.workflow.workflow import Workflow, read_workflow

"""What can go wrong between a workflow file and its results, each with a name to catch."""

from __future__ import annotations

import errno


class WorkflowError(ValueError):
    """A workflow that cannot be run as written: unknown names, cycles, wrong configuration."""


class UnknownStageError(WorkflowError):
    """No stage of this name is registered."""


class ForeignResultsError(WorkflowError):
    """The results folder holds results of another configuration."""


class DamagedStageError(RuntimeError):
    """A finished stage's folder no longer holds what its manifest lists."""


class DiskFullError(OSError):
    """No room was left while writing; what is finished is kept and a rerun goes on from there."""

    def __init__(self, message: str) -> None:
        super().__init__(errno.ENOSPC, message)

"""What can be wrong with a workflow; every message says what would be right."""


class WorkflowError(ValueError):
    """A workflow that cannot be run as it is described."""


class DamagedStageError(RuntimeError):
    """The finished output of a stage was changed."""

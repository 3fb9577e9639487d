"""Demonstrations: the eight tasks, the scripted demonstrator, the dataset and its noisy copies."""

from knotflow.samplers.demonstrations.aim import aim, aim_anywhere, nudge, rearrange
from knotflow.samplers.demonstrations.dataset import (
    SHIPPED,
    Demonstration,
    DemonstrationError,
    add_demonstration,
    load_demonstrations,
    load_trials,
    merge_demonstrations,
    save_demonstrations,
)
from knotflow.samplers.demonstrations.noise import NoiseConfig, noisy_copies
from knotflow.samplers.demonstrations.prediction import (
    aim_predicted,
    followed,
    predicted_states,
    rearrange_predicted,
)
from knotflow.samplers.demonstrations.scripted import (
    DemonstratorConfig,
    Scored,
    demonstrate,
    succeed,
)
from knotflow.samplers.demonstrations.tasks import TASKS, Task, task, task_at

__all__ = [
    "SHIPPED",
    "TASKS",
    "Demonstration",
    "DemonstrationError",
    "DemonstratorConfig",
    "NoiseConfig",
    "Scored",
    "Task",
    "add_demonstration",
    "aim",
    "aim_anywhere",
    "aim_predicted",
    "demonstrate",
    "followed",
    "load_demonstrations",
    "load_trials",
    "merge_demonstrations",
    "noisy_copies",
    "nudge",
    "predicted_states",
    "rearrange",
    "rearrange_predicted",
    "save_demonstrations",
    "succeed",
    "task",
    "task_at",
]

"""Demonstrations: the eight tasks, heuristic splines, the scripted demonstrator, the dataset."""

from knotflow.samplers.demonstrations.dataset import (
    SHIPPED,
    TASKS,
    Demonstration,
    DemonstrationError,
    NoiseConfig,
    Task,
    add_demonstration,
    load_demonstrations,
    load_trials,
    merge_demonstrations,
    noisy_copies,
    save_demonstrations,
    task,
    task_at,
)
from knotflow.samplers.demonstrations.heuristic import (
    arranging_splines,
    heuristic_any_action,
    heuristic_splines,
    small_moves,
)
from knotflow.samplers.demonstrations.prediction import (
    predict_shapes,
    predict_states,
    screened_arranging_splines,
    screened_splines,
)
from knotflow.samplers.demonstrations.scripted import (
    Demonstrated,
    DemonstratorConfig,
    demonstrate,
    demonstrate_task,
    succeed,
)

__all__ = [
    "SHIPPED",
    "TASKS",
    "Demonstrated",
    "Demonstration",
    "DemonstrationError",
    "DemonstratorConfig",
    "NoiseConfig",
    "Task",
    "add_demonstration",
    "arranging_splines",
    "demonstrate",
    "demonstrate_task",
    "heuristic_any_action",
    "heuristic_splines",
    "load_demonstrations",
    "load_trials",
    "merge_demonstrations",
    "noisy_copies",
    "predict_shapes",
    "predict_states",
    "save_demonstrations",
    "screened_arranging_splines",
    "screened_splines",
    "small_moves",
    "succeed",
    "task",
    "task_at",
]

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
)
from knotflow.samplers.demonstrations.prediction import screened_arranging_splines, screened_splines
from knotflow.samplers.demonstrations.scripted import Demonstrator, DemonstratorConfig

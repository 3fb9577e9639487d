"""How far predicted ropes are from simulated ones, after so many steps and by level."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from knotflow.execution.rope_motions import Motions

if TYPE_CHECKING:
    from torch import Tensor

    from knotflow.execution.dynamics import RopeDynamics

STEPS = (1, 10, 25)
"""Steps of 0.1 s after which predictions are judged; 25 are a whole motion."""


def predict_motions(model: RopeDynamics, motions: Motions) -> Tensor:
    """All frames (N, T - 1, V, 3) after the first, predicted from the first alone, a rope at rest.

    What is known is what the gripper does: where it moves, and when it lets go.
    """
    import torch

    points = torch.from_numpy(motions.points[:, 0])
    gripper, grasped = torch.from_numpy(motions.gripper), torch.from_numpy(motions.grasped)
    with torch.no_grad():
        return model.predict(points, torch.zeros_like(points), grasped[:, :-1], gripper[:, 1:])


def prediction_errors(models: Mapping[str, RopeDynamics], motions: Motions) -> pd.DataFrame:
    """A row a model, level and number of steps: model, level, steps, motions, mean_error_mm.

    The error is the mean distance of predicted from true vertices.
    """
    rows = []
    for name, model in models.items():
        away = predict_motions(model, motions).numpy() - motions.points[:, 1:]
        error = 1e3 * np.linalg.norm(away, axis=-1).mean(axis=-1)  # (N, T - 1)
        for level in np.unique(motions.level):
            of_level = motions.level == level
            for steps in STEPS:
                mean = float(error[of_level, steps - 1].mean())
                rows.append((name, level, steps, of_level.sum(), round(mean, 2)))
    columns = ["model", "level", "steps", "motions", "mean_error_mm"]
    return pd.DataFrame(rows, columns=columns)

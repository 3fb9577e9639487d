"""Runs of gradient steps, and what they told on average."""

from __future__ import annotations

from knotflow.training.learner import Learner


def fit(learner: Learner, steps: int, closing: bool = False) -> dict[str, float]:
    """Make gradient steps; gives the mean losses, and what goes with them.

    Args:
        learner: what learns.
        steps: how many.
        closing: let the learning rate fall evenly to 0 over these steps.
    """
    means: dict[str, float] = {}
    for step in range(steps):
        told = learner.update(1 - step / steps if closing else 1.0)
        for key, value in told.items():
            means[key] = means.get(key, 0.0) + value / steps
    return means

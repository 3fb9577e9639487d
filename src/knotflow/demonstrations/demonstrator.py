"""The demonstrator's round: one demonstration of each task on each of its start shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from knotflow.demonstrations.aim import aim
from knotflow.demonstrations.dataset import Demonstration
from knotflow.demonstrations.scripted import DemonstratorConfig, demonstrate
from knotflow.demonstrations.tasks import TASKS, Task
from knotflow.simulation import Observer, RopeSimulator, StartsConfig, reached, straight

MOST_STARTS = 20
"""Starts tried for one demonstration."""


@dataclass(frozen=True)
class Demonstrated:
    """A demonstration, and what it took."""

    demonstration: Demonstration
    share: float
    """Of its noisy copies that succeed."""
    starts_left_out: int
    """Starts given up before."""


def wanted(config: DemonstratorConfig) -> Mapping[str, tuple[Task, list[int]]]:
    """Each demonstration's name, task and seed."""
    return {
        f"{task.name}-{i}": (task, [config.seed, number, i])
        for number, task in enumerate(TASKS)
        for i in range(config.starts_per_task if task.start_actions else 1)
    }


def demonstrate_from_any_start(
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig,
    starts: StartsConfig,
    observe: Observer | None = None,
) -> Demonstrated:
    """A robust demonstration of a task from the first start that allows one.

    Args:
        task: begins tangled, from a random start, or untangled, from a straight rope.
        simulator: tells which splines succeed.
        rng: everything random comes from it.
        config: the effort to spend, and the least share that must succeed.
        starts: what a random start looks like.
        observe: is shown every attempt.

    Raises:
        RuntimeError: no start was any good.
    """
    for left_out in range(MOST_STARTS):
        if task.start_actions:
            found = reached(task.start_actions, 1, simulator, aim, rng, starts, observe)
            points = found.points[0]
        else:
            points = straight(simulator.config.rope)
        result = demonstrate(points, task, simulator, rng, config, observe)
        if result is not None and result[1] >= config.least_share:
            spline, share = result
            return Demonstrated(Demonstration(task, points, spline, "scripted"), share, left_out)
    raise RuntimeError(
        f"no spline for {task.action} had {config.least_share:.0%} of its noisy copies succeed on "
        f"any of {MOST_STARTS} starts; lower least_share or raise the demonstrator's effort"
    )

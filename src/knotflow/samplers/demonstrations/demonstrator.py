"""The demonstrator's round: the demonstrations of a task, each on a start shape of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations.aim import aim
from knotflow.samplers.demonstrations.dataset import Demonstration
from knotflow.samplers.demonstrations.scripted import DemonstratorConfig, Scored, demonstrate
from knotflow.samplers.demonstrations.tasks import Task
from knotflow.simulation import Observer, RopeSimulator, StartsConfig, reach_starts, straight

MOST_STARTS = 20
"""Starts tried for one demonstration."""


@dataclass(frozen=True)
class Demonstrated:
    """A demonstration, and what it took."""

    demonstration: Demonstration
    scored: Scored
    """Its spline, the shape it leaves, and how good it is."""
    starts_left_out: int
    """Starts given up before."""


def demonstrate_task(
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig,
    starts: StartsConfig,
    observe: Observer | None = None,
) -> list[Demonstrated]:
    """Demonstrations of a task, each from the first start that allows one.

    An untangled task has one, for it begins with one shape, the straight rope: the best of a few.

    Args:
        task: begins tangled, from random starts, or untangled.
        simulator: decides which splines succeed.
        rng: everything random comes from it.
        config: the effort to spend, and the least share that must succeed.
        starts: what a random start looks like.
        observe: is shown every attempt.

    Raises:
        RuntimeError: no start was any good.
    """
    count = config.starts_per_task
    if not task.start_actions:
        count = config.straight_searches
        config = replace(config, room_guesses=config.room_guesses * count)
    candidates = _starts(task, count, simulator, rng, starts, observe)
    found = []
    for _ in range(count):
        for left_out in range(MOST_STARTS):
            # To a micrometre, as a file holds them: what is tried is what will be read.
            points = np.round(next(candidates), 6)
            scored = demonstrate(points, task, simulator, rng, config, observe)
            if scored is not None:
                shown = Demonstration(task, points, scored.spline, "scripted")
                found.append(Demonstrated(shown, scored, left_out))
                break
        else:
            raise RuntimeError(
                f"no spline for {task.action} succeeded together with {config.least_share:.0%} of "
                f"its noisy copies on any of {MOST_STARTS} starts; lower least_share or raise the "
                "demonstrator's effort"
            )
    return found if task.start_actions else [max(found, key=lambda one: one.scored.score)]


def _starts(
    task: Task,
    count: int,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    starts: StartsConfig,
    observe: Observer | None,
) -> Iterator[NDArray]:
    """Start shapes (V, 3), made `count` at once since they descend from many ropes anyway."""
    while True:
        if not task.start_actions:
            yield straight(simulator.config.rope)
        else:
            yield from reach_starts(
                task.start_actions, count, simulator, aim, rng, starts, observe
            ).points

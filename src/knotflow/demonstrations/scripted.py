"""The scripted demonstrator: aimed guesses, refined by cross-entropy search in the simulator.

It stands in for the people who clicked on three points of an image in Sec. V-B a. What it looks
for is what a careful person gives: a spline whose noisy copies succeed too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from knotflow.demonstrations.aim import aim
from knotflow.demonstrations.noise import NoiseConfig, noisy_copies
from knotflow.demonstrations.tasks import Task
from knotflow.simulation import Observer, RopeSimulator, attempt, clip_splines


@dataclass
class DemonstratorConfig:
    """How many demonstrations are made, and how long is searched for each."""

    starts_per_task: int = 8
    """Start shapes of each task that begins tangled; an untangled one begins straight, once."""
    guesses: int = 128
    """Aimed guesses that are simulated first."""
    samples: int = 40
    """Splines simulated in each iteration of the search."""
    iterations: int = 4
    """Iterations of the search."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """The noise a demonstrated spline has to bear."""
    least_share: float = 0.4
    """Share of its noisy copies that must succeed; a start that gets none so good is replaced."""
    seed: int = 1
    """Of everything random."""


def demonstrate(
    points: NDArray,
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig | None = None,
    observe: Observer | None = None,
) -> tuple[NDArray[np.float64], float] | None:
    """The most robust spline found for a task on a rope.

    Args:
        points: (V, 3) rope vertices in the task's start state, metres.
        task: the action to demonstrate.
        simulator: tells which splines succeed.
        rng: everything random comes from it.
        config: the effort to spend.
        observe: is shown every attempt.

    Returns:
        The spline (6,) and the share of its noisy copies that succeeded, or None where not one
        aimed guess did.
    """
    config = config or DemonstratorConfig()
    splines = aim(points, task.action, config.guesses, rng)
    success = succeed(points, splines, task, simulator, observe)
    if not success.any():
        return None
    mean, spread = _fit(splines[success], config.noise)
    best, best_share = splines[success][0], 0.0
    for _ in range(config.iterations):
        candidate = clip_splines(mean)
        copies = noisy_copies(candidate, config.samples, rng, config.noise)
        success_of_copies = succeed(points, copies, task, simulator, observe)
        share = float(success_of_copies.mean())
        if share >= best_share:
            best, best_share = candidate, share
        wide = clip_splines(rng.normal(mean, spread, (config.samples, 6)))
        success_of_wide = succeed(points, wide, task, simulator, observe)
        elites = np.concatenate([copies[success_of_copies], wide[success_of_wide]])
        if len(elites) == 0:
            # The successes form no single cloud; go on from one of them.
            mean = splines[success][rng.integers(success.sum())]
            continue
        mean, spread = _fit(elites, config.noise)
    return best, best_share


def succeed(
    points: NDArray,
    splines: NDArray,
    task: Task,
    simulator: RopeSimulator,
    observe: Observer | None = None,
) -> NDArray[np.bool_]:
    """Which splines (N, 6) bring the rope (V, 3) to the task's goal state, as (N,) bool."""
    return attempt(simulator, points, splines, task.action, task.start_state, observe).success


def _fit(elites: NDArray, noise: NoiseConfig) -> tuple[NDArray, NDArray]:
    """Mean and spread (6,) of the elites, the spread never below the noise."""
    return elites.mean(axis=0), np.maximum(elites.std(axis=0), noise.scale)

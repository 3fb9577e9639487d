"""The scripted demonstrator: aimed guesses, refined by cross-entropy search in the simulator.

It stands in for the people who clicked on three points of an image in Sec. V-B a. What it looks
for is what a careful person gives: a spline whose noisy copies succeed too, and whose end leaves
room for the actions that follow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations.aim import aim
from knotflow.samplers.demonstrations.noise import NoiseConfig, noisy_copies
from knotflow.samplers.demonstrations.room import loop_size, next_actions, room
from knotflow.samplers.demonstrations.tasks import Task
from knotflow.simulation import (
    Attempts,
    Observer,
    RopeConfig,
    RopeSimulator,
    attempt,
    clip_splines,
)


@dataclass
class DemonstratorConfig:
    """How many demonstrations are made, and how long is searched for each."""

    starts_per_task: int = 8
    """Start shapes of each task that begins tangled; an untangled one begins straight, once."""
    straight_searches: int = 4
    """Searches from the straight rope, of which the best is kept."""
    guesses: int = 96
    """Aimed guesses that are simulated first, at most."""
    hits: int = 4
    """Successes among the guesses that are enough to begin the search with."""
    samples: int = 18
    """Noisy copies of a candidate in each iteration of the search."""
    wide: int = 8
    """Splines simulated beside them, drawn as widely as the successes so far are spread."""
    iterations: int = 3
    """Iterations of the search, each with one candidate."""
    finalists: int = 2
    """Candidates whose room is measured."""
    room_guesses: int = 12
    """Aimed guesses at each action that may follow, from the ends of a finalist's copies; from the
    straight rope as many times more as there are searches, since the best of many measured roughly
    is the luckiest of them."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """The noise a demonstrated spline has to bear."""
    least_share: float = 0.4
    """Share of its noisy copies that must succeed; a start that gets none so good is replaced."""
    seed: int = 1
    """Of everything random."""


@dataclass(frozen=True)
class Scored:
    """A spline (6,) that succeeds, and how good a demonstration it is."""

    spline: NDArray[np.float64]
    end: NDArray[np.float64]
    """(V, 3) the rope after it, metres."""
    share: float
    """Of its noisy copies that succeed."""
    room: float
    """That the ends of these leave, see `room.room`."""

    @property
    def score(self) -> float:
        """How likely a noisy copy succeeds, and a first guess at what follows does, too."""
        return self.share * self.room


@dataclass(frozen=True)
class _Candidate:
    """A spline (6,), its end (V, 3), and the ends (E, V, 3) of its copies that succeeded."""

    spline: NDArray[np.float64]
    end: NDArray[np.float64]
    share: float
    ends: NDArray[np.float64]
    size: float  # metres: the mean of the ends' loop sizes

    @property
    def promise(self) -> float:
        """A guess at its score that takes no simulation."""
        return self.share * self.size


def demonstrate(
    points: NDArray,
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig | None = None,
    observe: Observer | None = None,
) -> Scored | None:
    """The spline with the best score found for a task on a rope.

    A filter that costs nothing comes before the score: the size of the loops and free ends that a
    success leaves (`room.loop_size`). The search follows the roomier half of the successes, and
    the room of its most promising candidates is then measured.

    Args:
        points: (V, 3) rope vertices in the task's start state, metres.
        task: the action to demonstrate.
        simulator: decides which splines succeed.
        rng: everything random comes from it.
        config: the effort to spend.
        observe: is shown every attempt.

    Returns:
        The spline and its score, or None where no spline was found that succeeds, and does so with
        `least_share` of its noisy copies.
    """
    config = config or DemonstratorConfig()

    def execute(splines: NDArray) -> Attempts:
        return attempt(simulator, points, splines, task.action, task.start_state, observe)

    hits = _guess(points, task, rng, config, execute)
    if hits is None:
        return None
    rope = simulator.config.rope
    first, _ = hits
    mean, spread = _fit(_roomier_half(*hits, rope), config.noise)
    candidates = []
    for _ in range(config.iterations):
        spline = np.round(clip_splines(mean), 6)  # as a file holds it
        copies = noisy_copies(spline, config.samples, rng, config.noise)
        wide = clip_splines(rng.normal(mean, spread, (config.wide, 6)))
        tried = execute(np.concatenate([spline[None], copies, wide]))
        success, ends = tried.success, tried.rollouts.end_points
        of_copies = 1 + np.flatnonzero(success[1 : 1 + config.samples])
        if success[0] and len(of_copies):
            share = len(of_copies) / config.samples
            size = np.mean([loop_size(end, rope) for end in ends[of_copies]])
            candidates.append(_Candidate(spline, ends[0], share, ends[of_copies], float(size)))
        if not success.any():
            # The successes form no single cloud; go on from one of them.
            mean = first[rng.integers(len(first))]
            continue
        elites = tried.splines[success], ends[success]
        mean, spread = _fit(_roomier_half(*elites, rope), config.noise)
    robust = [one for one in candidates if one.share >= config.least_share]
    robust.sort(key=lambda one: one.promise, reverse=True)
    return _best(robust[: config.finalists], task, simulator, rng, config, observe)


def succeed(
    points: NDArray,
    splines: NDArray,
    task: Task,
    simulator: RopeSimulator,
    observe: Observer | None = None,
) -> NDArray[np.bool_]:
    """Which splines (N, 6) bring the rope (V, 3) to the task's goal state, as (N,) bool."""
    return attempt(simulator, points, splines, task.action, task.start_state, observe).success


_ROUND = 32  # guesses simulated before their successes are counted


def _guess(
    points: NDArray,
    task: Task,
    rng: np.random.Generator,
    config: DemonstratorConfig,
    execute: Callable[[NDArray], Attempts],
) -> tuple[NDArray, NDArray] | None:
    """Aimed guesses (N, 6) that succeed and their ends (N, V, 3); None where none does."""
    splines: list[NDArray] = []
    ends: list[NDArray] = []
    for begun in range(0, config.guesses, _ROUND):
        count = min(_ROUND, config.guesses - begun)
        tried = execute(aim(points, task.action, count, rng))
        splines.extend(tried.splines[tried.success])
        ends.extend(tried.rollouts.end_points[tried.success])
        if len(splines) >= config.hits:
            break
    return (np.stack(splines), np.stack(ends)) if splines else None


def _best(
    finalists: Sequence[_Candidate],
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig,
    observe: Observer | None,
) -> Scored | None:
    """The finalist with the best score, None of none; room is measured by the same actions."""
    actions, state = next_actions(task, rng), task.goal_state
    scored = [
        Scored(
            one.spline,
            one.end,
            one.share,
            room(one.ends, state, actions, config.room_guesses, simulator, rng, observe),
        )
        for one in finalists
    ]
    return max(scored, key=lambda one: one.score, default=None)


def _roomier_half(splines: NDArray, ends: NDArray, rope: RopeConfig) -> NDArray:
    """Of splines (N, 6), those whose ends (N, V, 3) have the larger loops."""
    keep = max(4, (len(splines) + 1) // 2)
    order = np.argsort([-loop_size(end, rope) for end in ends], kind="stable")[:keep]
    return splines[order]


def _fit(elites: NDArray, noise: NoiseConfig) -> tuple[NDArray, NDArray]:
    """Mean and spread (6,) of the elites, the spread never below the noise."""
    return elites.mean(axis=0), np.maximum(elites.std(axis=0), noise.scale)

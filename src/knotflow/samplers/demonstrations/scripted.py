"""The scripted demonstrator: heuristic splines, refined by cross-entropy search in the simulator.

It stands in for the people who clicked on three points of an image (Sec. V-B a): it looks for a
spline whose noisy copies succeed too, and whose end leaves clearance for the next actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations.clearance import clearance, loop_size, next_actions
from knotflow.samplers.demonstrations.dataset import Demonstration, NoiseConfig, Task, noisy_copies
from knotflow.samplers.demonstrations.heuristic import heuristic_splines
from knotflow.simulation import (
    Attempts,
    Observer,
    RopeConfig,
    RopeSimulator,
    StartsConfig,
    attempt,
    clip_splines,
    reach_starts,
    straight,
)
from knotflow.topology.polyline import Floats

MOST_STARTS = 20
"""Starts tried for one demonstration."""
BATCH = 32
"""Heuristic splines simulated before their successes are counted."""


@dataclass
class DemonstratorConfig:
    """How many demonstrations are made, and how long is searched for each."""

    starts_per_task: int = 8
    """Start shapes of each task that begins tangled; an untangled one begins straight, once."""
    straight_searches: int = 4
    """Searches from the straight rope, of which the best is kept."""
    guesses: int = 96
    """Heuristic splines that are simulated first, at most."""
    hits: int = 4
    """Successes among them that are enough to begin the search with."""
    samples: int = 18
    """Noisy copies of a candidate in each iteration of the search."""
    wide: int = 8
    """Splines simulated beside them, as widely spread as the successes so far."""
    iterations: int = 3
    """Iterations of the search, each with one candidate."""
    finalists: int = 2
    """Candidates whose clearance is measured."""
    room_guesses: int = 12
    """Heuristic splines for each next action, from the ends of a finalist's copies; from the
    straight rope as many times more as there are searches."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """The noise of the copies."""
    least_share: float = 0.4
    """Share of its noisy copies that must succeed; otherwise the start is replaced."""
    seed: int = 1
    """Of everything random."""


@dataclass(frozen=True)
class ScoredSpline:
    """A spline that succeeds, and how good a demonstration it is."""

    spline: Floats
    """(6,)"""
    end: Floats
    """(V, 3) the rope after it, metres."""
    success_rate: float
    """Of its noisy copies."""
    clearance: float
    """Of the copies' ends, see `clearance.clearance`."""

    @property
    def score(self) -> float:
        """Probability that a noisy copy succeeds, and a heuristic next action after it."""
        return self.success_rate * self.clearance


@dataclass(frozen=True)
class _Candidate:
    """A spline (6,), its end (V, 3), and the ends (E, V, 3) of its copies that succeeded."""

    spline: Floats
    end: Floats
    success_rate: float
    ends: Floats
    loop_size: float  # mean over `ends`, metres


@dataclass(frozen=True)
class Demonstrated:
    """A demonstration, and what it took."""

    demonstration: Demonstration
    scored: ScoredSpline
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

    An untangled task begins with one shape, the straight rope, and has one: the best of a few.

    Args:
        task: begins tangled, from random starts, or untangled.
        simulator: decides which splines succeed.
        rng: everything random comes from it.
        config: the effort to spend, and the least share that must succeed.
        starts: distribution of random starts.
        observe: is shown every attempt.

    Raises:
        RuntimeError: no start allowed one.
    """
    count = config.starts_per_task
    if not task.start_actions:
        count = config.straight_searches
        config = replace(config, room_guesses=config.room_guesses * count)
    candidates = _starts(task, count, simulator, rng, starts, observe)
    found = []
    for _ in range(count):
        for left_out in range(MOST_STARTS):
            points = np.round(next(candidates), 6)  # as a file holds them
            scored = demonstrate(points, task, simulator, rng, config, observe)
            if scored is not None:
                demonstration = Demonstration(task, points, scored.spline, "scripted")
                found.append(Demonstrated(demonstration, scored, left_out))
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
) -> Iterator[Floats]:
    """Start shapes (V, 3), made `count` at a time."""
    while True:
        if not task.start_actions:
            yield straight(simulator.config.rope)
        else:
            yield from reach_starts(
                task.start_actions, count, simulator, heuristic_splines, rng, starts, observe
            ).points


def demonstrate(
    points: Floats,
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig | None = None,
    observe: Observer | None = None,
) -> ScoredSpline | None:
    """The spline with the best score found for a task on a rope.

    The search follows the half of the successes with the larger loops; the clearance of its most
    promising candidates is measured.

    Args:
        points: (V, 3) rope vertices in the task's start state, metres.
        task: the action to demonstrate.
        simulator: decides which splines succeed.
        rng: everything random comes from it.
        config: the effort to spend.
        observe: is shown every attempt.

    Returns:
        None where no spline succeeds with `least_share` of its noisy copies.
    """
    config = config or DemonstratorConfig()

    def execute(splines: Floats) -> Attempts:
        return attempt(simulator, points, splines, task.action, task.start_state, observe)

    first, first_ends = _heuristic_successes(points, task, rng, config, execute)
    if not len(first):
        return None
    rope = simulator.config.rope
    mean, spread = _fit(_larger_loops(first, first_ends, rope), config.noise)
    candidates = []
    for _ in range(config.iterations):
        spline = np.round(clip_splines(mean), 6)  # as a file holds it
        copies = noisy_copies(spline, config.samples, rng, config.noise)
        wide = clip_splines(rng.normal(mean, spread, (config.wide, 6)))
        tried = execute(np.concatenate([spline[None], copies, wide]))
        success, ends = tried.success, tried.rollouts.end_points
        of_copies = 1 + np.flatnonzero(success[1 : 1 + config.samples])
        if success[0] and len(of_copies):
            rate = len(of_copies) / config.samples
            size = float(np.mean([loop_size(end, rope) for end in ends[of_copies]]))
            candidates.append(_Candidate(spline, ends[0], rate, ends[of_copies], size))
        if not success.any():
            # The successes form several clusters; continue from one of them.
            mean = first[rng.integers(len(first))]
            continue
        elites = _larger_loops(tried.splines[success], ends[success], rope)
        mean, spread = _fit(elites, config.noise)
    robust = [one for one in candidates if one.success_rate >= config.least_share]
    robust.sort(key=lambda one: one.success_rate * one.loop_size, reverse=True)
    return _best(robust[: config.finalists], task, simulator, rng, config, observe)


def succeed(
    points: Floats,
    splines: Floats,
    task: Task,
    simulator: RopeSimulator,
    observe: Observer | None = None,
) -> NDArray[np.bool_]:
    """Which splines (N, 6) bring the rope (V, 3) to the task's goal state, as (N,) bool."""
    return attempt(simulator, points, splines, task.action, task.start_state, observe).success


def _heuristic_successes(
    points: Floats,
    task: Task,
    rng: np.random.Generator,
    config: DemonstratorConfig,
    execute: Callable[[Floats], Attempts],
) -> tuple[Floats, Floats]:
    """Heuristic splines (N, 6) that succeed and their ends (N, V, 3)."""
    splines, ends = [np.empty((0, 6))], [np.empty((0, *points.shape))]
    for begun in range(0, config.guesses, BATCH):
        count = min(BATCH, config.guesses - begun)
        tried = execute(heuristic_splines(points, task.action, count, rng))
        splines.append(tried.splines[tried.success])
        ends.append(tried.rollouts.end_points[tried.success])
        if sum(map(len, splines)) >= config.hits:
            break
    return np.concatenate(splines), np.concatenate(ends)


def _best(
    finalists: Sequence[_Candidate],
    task: Task,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: DemonstratorConfig,
    observe: Observer | None,
) -> ScoredSpline | None:
    """The finalist with the best score, None of none; clearance is measured by the same actions."""
    actions, state = next_actions(task, rng), task.goal_state
    scored = [
        ScoredSpline(
            one.spline,
            one.end,
            one.success_rate,
            clearance(one.ends, state, actions, config.room_guesses, simulator, rng, observe),
        )
        for one in finalists
    ]
    return max(scored, key=lambda one: one.score, default=None)


def _larger_loops(splines: Floats, ends: Floats, rope: RopeConfig) -> Floats:
    """Half of the splines (N, 6), at least four: those whose ends (N, V, 3) have larger loops."""
    keep = max(4, (len(splines) + 1) // 2)
    order = np.argsort([-loop_size(end, rope) for end in ends], kind="stable")[:keep]
    return splines[order]


def _fit(elites: Floats, noise: NoiseConfig) -> tuple[Floats, Floats]:
    """Mean and spread (6,) of the elites, the spread never below the noise."""
    return elites.mean(axis=0), np.maximum(elites.std(axis=0), noise.scale)

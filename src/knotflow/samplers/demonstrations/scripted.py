"""The scripted demonstrator: heuristic splines, refined by cross-entropy search in the simulator.

In place of people (Sec. V-B a), it looks for a spline whose noisy copies succeed too, and whose end
leaves clearance for the next actions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from knotflow.samplers.demonstrations.dataset import (
    TASKS,
    Demonstration,
    NoiseConfig,
    Task,
    noisy_copies,
)
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
from knotflow.topology import Action, Cross, segment_lengths
from knotflow.topology.polyline import Floats

MOST_STARTS = 20
"""Starts tried for one demonstration."""
BATCH = 32
"""Heuristic splines simulated before their successes are counted."""
MOST_ACTIONS = 2
"""Next actions drawn where no task begins in the reached state."""


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
    """Iterations of the search, each with one candidate; with 0, the first success is kept."""
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
class Candidate:
    """A spline that succeeds, and how good a demonstration it is."""

    spline: Floats  # (6,)
    end: Floats  # (V, 3) the rope after it, metres
    ends: Floats  # (E, V, 3) after those of its noisy copies that succeed
    success_rate: float  # of its noisy copies
    loop_size: float  # mean over `ends`, metres
    clearance: float = 0.0  # of `ends`, see `Demonstrator.clearance`

    @property
    def score(self) -> float:
        """Probability that a noisy copy succeeds, and a heuristic next action after it."""
        return self.success_rate * self.clearance


Demonstrated = tuple[Demonstration, Candidate, int]
"""A demonstration, how good it is, and the number of starts given up before."""


@dataclass(frozen=True)
class Demonstrator:
    """Demonstrates a task; `observe` is shown every attempt."""

    task: Task
    simulator: RopeSimulator
    rng: np.random.Generator
    config: DemonstratorConfig = field(default_factory=DemonstratorConfig)
    starts: StartsConfig = field(default_factory=StartsConfig)
    observe: Observer | None = None

    def demonstrations(self) -> list[Demonstrated]:
        """Demonstrations, each from the first start that allows one; from the straight rope one.

        Raises:
            RuntimeError: no start allowed one.
        """
        config = self.config
        if self.task.start_actions:
            return self._search(config.starts_per_task)
        count = config.straight_searches
        config = replace(config, room_guesses=config.room_guesses * count)
        found = replace(self, config=config)._search(count)
        return [max(found, key=lambda one: one[1].score)]

    def _search(self, count: int) -> list[Demonstrated]:
        candidates = self._starts(count)
        found = []
        for _ in range(count):
            for left_out in range(MOST_STARTS):
                points = np.round(next(candidates), 6)  # as a file holds them
                scored = self.demonstrate(points)
                if scored is not None:
                    demonstration = Demonstration(self.task, points, scored.spline, "scripted")
                    found.append((demonstration, scored, left_out))
                    break
            else:
                raise RuntimeError(
                    f"no spline for {self.task.action} succeeded together with "
                    f"{self.config.least_share:.0%} of its noisy copies on any of {MOST_STARTS} "
                    "starts; lower least_share or raise the demonstrator's effort"
                )
        return found

    def _starts(self, count: int) -> Iterator[Floats]:
        """Start shapes (V, 3), made `count` at a time."""
        path, simulator = self.task.start_actions, self.simulator
        while True:
            if not path:
                yield straight(simulator.config.rope)
            else:
                yield from reach_starts(
                    path, count, simulator, heuristic_splines, self.rng, self.starts, self.observe
                ).points

    def demonstrate(self, points: Floats) -> Candidate | None:
        """The spline with the best score found on a rope (V, 3), metres, in the start state.

        The search follows the successes with the larger loops. None where no spline succeeds with
        `least_share` of its noisy copies.
        """
        config, rng, task = self.config, self.rng, self.task

        def execute(splines: Floats) -> Attempts:
            return attempt(
                self.simulator, points, splines, task.action, task.start_state, self.observe
            )

        hits: list[Attempts] = []
        for begun in range(0, config.guesses, BATCH):
            count = min(BATCH, config.guesses - begun)
            hits.append(execute(heuristic_splines(points, task.action, count, rng)))
            if sum(int(tried.success.sum()) for tried in hits) >= config.hits:
                break
        first = np.concatenate([tried.splines[tried.success] for tried in hits])
        if not len(first):
            return None
        first_ends = np.concatenate([one.rollouts.end_points[one.success] for one in hits])
        rope = self.simulator.config.rope
        if config.iterations:
            mean, spread = _fit(larger_loops(first, first_ends, rope), config.noise)
        else:
            mean, spread = first[0], config.noise.scale
        candidates = []
        for _ in range(config.iterations or 1):
            spline = np.round(clip_splines(mean), 6)  # as a file holds it
            copies = noisy_copies(spline, config.samples, rng, config.noise)
            wide = clip_splines(rng.normal(mean, spread, (config.wide, 6)))
            tried = execute(np.concatenate([spline[None], copies, wide]))
            success, ends = tried.success, tried.rollouts.end_points
            of_copies = 1 + np.flatnonzero(success[1 : 1 + config.samples])
            if success[0] and len(of_copies):
                rate = len(of_copies) / config.samples
                size = float(np.mean([loop_size(end, rope) for end in ends[of_copies]]))
                candidates.append(Candidate(spline, ends[0], ends[of_copies], rate, size))
            if not success.any():
                # The successes form several clusters; continue from one of them.
                mean = first[rng.integers(len(first))]
                continue
            elites = larger_loops(tried.splines[success], ends[success], rope)
            mean, spread = _fit(elites, config.noise)
        robust = [one for one in candidates if one.success_rate >= config.least_share]
        robust.sort(key=lambda one: one.success_rate * one.loop_size, reverse=True)
        return self.best(robust[: config.finalists])

    def best(self, finalists: Sequence[Candidate]) -> Candidate | None:
        """The finalist with the best score, None of none; all have the same next actions."""
        actions = next_actions(self.task, self.rng)
        scored = [replace(one, clearance=self.clearance(one.ends, actions)) for one in finalists]
        return max(scored, key=lambda one: one.score, default=None)

    def clearance(self, ends: Floats, actions: Sequence[Action]) -> float:
        """Success rate of heuristic splines for the next actions from ropes (E, V, 3), 0 to 1.

        The geometric mean over the actions of Laplace's (successes + 1) / (trials + 2).
        """
        trials, state = self.config.room_guesses, self.task.goal_state
        ropes = ends[np.arange(trials) % len(ends)]
        shares = []
        for action in actions:
            splines = [heuristic_splines(points, action, 1, self.rng) for points in ropes]
            tried = attempt(
                self.simulator, ropes, np.concatenate(splines), action, state, self.observe
            )
            shares.append((tried.success.sum() + 1) / (trials + 2))
        return float(np.exp(np.mean(np.log(shares))))


def next_actions(task: Task, rng: np.random.Generator) -> tuple[Action, ...]:
    """The actions of `TASKS` from the state a task reaches; without any, random legal Crosses."""
    state = task.goal_state
    if known := tuple(one.action for one in TASKS if one.start_state == state):
        return known
    legal = [action for action, _ in state.actions() if isinstance(action, Cross)]
    drawn = rng.choice(len(legal), min(MOST_ACTIONS, len(legal)), replace=False)
    return tuple(legal[i] for i in drawn)


def loop_size(points: Floats, rope: RopeConfig) -> float:
    """Length of the shortest segment of a rope (V, 3), metres; ends count twice."""
    lengths = segment_lengths(points) * rope.length
    lengths[[0, -1]] *= 2
    return float(lengths.min())


def larger_loops(splines: Floats, ends: Floats, rope: RopeConfig) -> Floats:
    """Half of the splines (N, 6), at least four: those whose ends (N, V, 3) have larger loops."""
    keep = max(4, (len(splines) + 1) // 2)
    order = np.argsort([-loop_size(end, rope) for end in ends], kind="stable")[:keep]
    return splines[order]


def _fit(elites: Floats, noise: NoiseConfig) -> tuple[Floats, Floats]:
    """Mean and spread (6,) of the elites, the spread never below the noise."""
    return elites.mean(axis=0), np.maximum(elites.std(axis=0), noise.scale)

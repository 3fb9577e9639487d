"""A tied knot whose head is pulled out, in simulation, as the paper's authors did by hand
(Sec. VII-E)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knotflow.planning.config import PlannerConfig
from knotflow.planning.goals import Goal, parse_goal
from knotflow.planning.tree import plan_knot
from knotflow.samplers.demonstrations import heuristic_splines
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import Observer, RopeSimulator, attempt, clip_splines, straight
from knotflow.topology import Arrange, TopologicalState, parse_action, segment_lengths
from knotflow.topology.polyline import Floats


@dataclass
class PullConfig:
    """What is tied, and how its head is pulled."""

    path: str = "R1(0,1,1) C(0,1,1) C(2,0,1)"
    """The topological path that ties the knot, from a straight rope."""
    head: float = 0.15
    """Length of rope from the head to the first crossing at which it is long enough, metres."""
    shortest_segment: float = 0.02
    """Least length between neighbouring crossings that a pull may leave, metres."""
    pulls: int = 24
    """Random pulls from which one is kept."""
    rounds: int = 4
    """Pulls in succession at most."""
    next_action: str = "C(0,3,1)"
    """The action that the rope is to be ready for."""
    guesses: int = 32
    """Aimed guesses at it, by whose successes the ropes are compared."""
    seed: int = 40
    """Of everything random."""


@dataclass(frozen=True)
class PulledRope:
    """A tied rope (V, 3), metres, whose head was pulled out far enough."""

    points: Floats
    successes: int
    """Aimed guesses at the next action that succeeded."""


class HeadPuller:
    """Ties ropes and pulls their heads out; each call of `pull` gives one more.

    Of some random pulls the one is kept that keeps the state, leaves every inner segment long
    enough, and gives the longest head.
    """

    def __init__(
        self,
        config: PullConfig,
        sampler: Sampler,
        simulator: RopeSimulator,
        observe: Observer | None = None,
        observe_pulls: Observer | None = None,
    ) -> None:
        self._config, self._sampler, self._simulator = config, sampler, simulator
        self._observe, self._observe_pulls = observe, observe_pulls
        self._rng = np.random.default_rng(config.seed)
        self._goal = parse_goal(config.path, simulator.config.rope)
        self._next_action = parse_action(config.next_action)

    def pull(self) -> PulledRope | None:
        """Tie a rope and pull its head; None where it does not come out far enough.

        Raises:
            RuntimeError: the knot could not be tied.
        """
        config, simulator, rng = self._config, self._simulator, self._rng
        search = PlannerConfig(rule="paper", batch=16, failure_discount=0.9)
        points = tie(self._goal, self._sampler, simulator, rng, search, self._observe)
        state = TopologicalState.from_curve(points)
        for _ in range(config.rounds):
            if self._head_length(points) >= config.head:
                break
            splines, action = random_pulls(points, config.pulls, rng), Arrange(self._next_action)
            pulls = attempt(simulator, points, splines, action, state, self._observe_pulls)
            # The present rope comes first, and so is kept where no pull improves it.
            ropes = [points, *pulls.rollouts.end_points[pulls.success]]
            points = max(ropes, key=self._head_length)
        if self._head_length(points) < config.head:
            return None
        splines = heuristic_splines(points, self._next_action, config.guesses, rng)
        tried = attempt(simulator, points, splines, self._next_action, state, self._observe)
        return PulledRope(points, int(tried.success.sum()))

    def _head_length(self, points: Floats) -> float:
        """Length from the head to the first crossing, metres; 0 where a segment is too short."""
        lengths = segment_lengths(points) * self._simulator.config.rope.length
        return float(lengths[0]) if lengths[1:-1].min() >= self._config.shortest_segment else 0.0


def tie(
    goal: Goal,
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: PlannerConfig,
    observe: Observer | None = None,
) -> Floats:
    """A straight rope (V, 3), metres, after a search has tied it.

    Raises:
        RuntimeError: the search failed.
    """
    start = straight(simulator.config.rope)
    plan = plan_knot(start, goal, sampler, simulator, rng, config, observe=observe)
    if not plan.solved:
        raise RuntimeError(f"no straight rope could be tied to {goal.name}: {plan.reason}")
    return np.asarray(plan.shapes[-1])


def random_pulls(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Splines (count, 6) that draw the head of a rope (V, 3) away, about where it points."""
    outward = points[0, :2] - points[2, :2]
    angle = np.arctan2(outward[1], outward[0]) + rng.normal(0.0, 0.8, count)
    distance = rng.uniform(0.05, 0.3, count)[:, None]
    end = points[0, :2] + distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = (points[0, :2] + end) / 2
    height = np.full(count, 0.05)  # low, so that no other strand is lifted
    return clip_splines(np.column_stack([np.zeros(count), middle, height, end]))


def select_best_pull(ropes: Sequence[PulledRope | None], head: float) -> Floats:
    """The rope (V, 3) with the most successes at the next action; the first of equals.

    `ropes` are None where the head did not come out to `head` metres.

    Raises:
        RuntimeError: there is none.
    """
    pulled = [rope for rope in ropes if rope is not None]
    if not pulled:
        raise RuntimeError(
            f"no head could be pulled out to {head:g} m in {len(ropes)} knots; lower "
            "head, or raise pulls, rounds or knots"
        )
    return max(pulled, key=lambda rope: rope.successes).points

"""A tied knot whose head is pulled out, as by hand (Sec. VII-E).

The paper's authors pulled the head segment out by hand before the pentagram was planned, for no
primitive has learned it. Here a rope is first tied along a topological path by a planner,
then its head is grasped and drawn away over the table, a few times. A pull is a spline like any
other: grasped at the very head, moved low in about the direction in which the head points. Of a
number of random pulls the one is kept that leaves the topological state as it is, every inner
segment long enough to work with, and the longest head. A person would not pull a rope into a shape
in which nothing can be done with it; so of a few ropes the one is taken in which aimed guesses at
the next action succeed most often. What ties the rope has no say in how it is pulled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.goals import Goal, parse_goal
from knotflow.planning.growth import PlannerConfig
from knotflow.planning.tree import plan_knot
from knotflow.samplers.demonstrations import aim
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import (
    Observer,
    RopeSimulator,
    attempt,
    clip_splines,
    straight,
)
from knotflow.topology import Arrange, TopologicalState, parse_action, segment_lengths


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
    onward: str = "C(0,3,1)"
    """The action that the rope is to be ready for."""
    guesses: int = 32
    """Aimed guesses at it, by whose successes the ropes are compared."""
    seed: int = 40
    """Of everything random."""


@dataclass(frozen=True)
class PulledRope:
    """A tied rope whose head was pulled out far enough."""

    points: NDArray[np.float64]
    """(V, 3) metres."""
    onward: int
    """Aimed guesses at the next action that succeeded."""


class HeadPuller:
    """Ties ropes and pulls their heads out; each call of `pull` gives one more.

    Args:
        config: what is tied, and how it is pulled.
        sampler: proposes the splines that tie.
        simulator: executes everything.
        observe: is shown every attempt at an action.
        observe_pulls: is shown every batch of pulls.
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
        self._onward = parse_action(config.onward)

    def pull(self) -> PulledRope | None:
        """Tie a rope and pull its head; None where it does not come out far enough.

        Raises:
            RuntimeError: the knot could not be tied.
        """
        points = self._tie()
        state = TopologicalState.from_curve(points)
        for _ in range(self._config.rounds):
            if self._head(points) >= self._config.head:
                break
            points = self._pulled(points, state)
        if self._head(points) < self._config.head:
            return None
        splines = aim(points, self._onward, self._config.guesses, self._rng)
        tried = attempt(self._simulator, points, splines, self._onward, state, self._observe)
        return PulledRope(points, int(tried.success.sum()))

    def _tie(self) -> NDArray[np.float64]:
        """A tied rope (V, 3)."""
        return tie(
            self._goal,
            self._sampler,
            self._simulator,
            self._rng,
            PlannerConfig(rule="paper", batch=16, failure_discount=0.9),
            self._observe,
        )

    def _pulled(self, points: NDArray, state: TopologicalState) -> NDArray[np.float64]:
        """The rope (V, 3) after the best of some random pulls, or as it was if none is any good."""
        splines = random_pulls(points, self._config.pulls, self._rng)
        arranging = Arrange(self._onward)
        pulls = attempt(self._simulator, points, splines, arranging, state, self._observe_pulls)
        # The rope as it was stands first, and so stays where no pull betters it.
        return max([points, *pulls.rollouts.end_points[pulls.success]], key=self._head)

    def _head(self, points: NDArray) -> float:
        """Length from the head to the first crossing, metres; 0 where a segment is too short."""
        length = self._simulator.config.rope.length
        lengths = segment_lengths(points) * length
        return float(lengths[0]) if lengths[1:-1].min() >= self._config.shortest_segment else 0.0


def tie(
    goal: Goal,
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    config: PlannerConfig,
    observe: Observer | None = None,
) -> NDArray[np.float64]:
    """A rope (V, 3), metres, that was straight, as a search for the goal leaves it.

    Raises:
        RuntimeError: the search failed.
    """
    start = straight(simulator.config.rope)
    plan = plan_knot(start, goal, sampler, simulator, rng, config, observe=observe)
    if not plan.solved:
        raise RuntimeError(f"no straight rope could be tied to {goal.name}: {plan.reason}")
    return plan.shapes[-1]


def random_pulls(points: NDArray, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Splines (count, 6) that draw the head of a rope (V, 3) away, about where it points."""
    outward = points[0, :2] - points[2, :2]
    angle = np.arctan2(outward[1], outward[0]) + rng.normal(0.0, 0.8, count)
    distance = rng.uniform(0.05, 0.3, count)[:, None]
    end = points[0, :2] + distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = (points[0, :2] + end) / 2
    height = np.full(count, 0.05)  # low: nothing shall be lifted off the table
    return clip_splines(np.column_stack([np.zeros(count), middle, height, end]))


def readiest(ropes: Sequence[PulledRope | None], head: float) -> NDArray[np.float64]:
    """The rope (V, 3), metres, that is readiest for the next action; the first of equals.

    Args:
        ropes: those that were tied; None where the head did not come out far enough.
        head: how far that is, metres.

    Raises:
        RuntimeError: there is none.
    """
    pulled = [rope for rope in ropes if rope is not None]
    if not pulled:
        raise RuntimeError(
            f"no head could be pulled out to {head:g} m in {len(ropes)} knots; lower "
            "head, or raise pulls, rounds or knots"
        )
    return max(pulled, key=lambda rope: rope.onward).points

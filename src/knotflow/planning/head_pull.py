"""A tied knot whose head is pulled out, in simulation, as the paper's authors did by hand
(Sec. VII-E)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotflow.planning.config import PlannerConfig
from knotflow.planning.goals import Goal, parse_goal
from knotflow.planning.tree import plan_knot
from knotflow.samplers.demonstrations import heuristic_splines
from knotflow.samplers.sampler import Sampler
from knotflow.simulation import Observer, RopeSimulator, attempt, clip_splines, straight
from knotflow.topology import Arrange, Cross, TopologicalState, segment_lengths
from knotflow.topology.polyline import Floats

PATH = "R1(0,1,1) C(0,1,1) C(2,0,1)"
"""The topological path that ties the knot, from a straight rope."""
NEXT_ACTION = Cross(0, 3, 1)
"""The action that the rope is to be ready for."""
LEAST_HEAD = 0.15
"""Length of rope from the head to the first crossing at which it is long enough, metres."""
LEAST_SEGMENT = 0.02
"""Least length between neighbouring crossings that a pull may leave, metres."""
PULLS, ROUNDS = 24, 4
"""Random pulls from which one is kept, and how often in succession at most."""
GUESSES = 32
"""Aimed guesses at the next action, by whose successes the ropes are compared."""


def pull_head(
    sampler: Sampler,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    observe: Observer | None = None,
    observe_pulls: Observer | None = None,
) -> tuple[Floats, int] | None:
    """Tie a rope (V, 3), metres, and pull its head; None where it does not come out far enough.

    Of some random pulls the one is kept that keeps the state, leaves every inner segment long
    enough, and gives the longest head. With the rope come the successes of aimed guesses at the
    next action.

    Raises:
        RuntimeError: the knot could not be tied.
    """

    def head_length(points: Floats) -> float:
        """Length from the head to the first crossing, metres; 0 where a segment is too short."""
        lengths = segment_lengths(points) * simulator.config.rope.length
        return float(lengths[0]) if lengths[1:-1].min() >= LEAST_SEGMENT else 0.0

    goal = parse_goal(PATH, simulator.config.rope)
    search = PlannerConfig(batch=16)
    points = tie(goal, sampler, simulator, rng, search, observe)
    state = TopologicalState.from_curve(points)
    for _ in range(ROUNDS):
        if head_length(points) >= LEAST_HEAD:
            break
        splines, action = _random_pulls(points, rng), Arrange(NEXT_ACTION)
        pulls = attempt(simulator, points, splines, action, state, observe_pulls)
        # The present rope comes first, and so is kept where no pull improves it.
        points = max([points, *pulls.rollouts.end_points[pulls.success]], key=head_length)
    if head_length(points) < LEAST_HEAD:
        return None
    splines = heuristic_splines(points, NEXT_ACTION, GUESSES, rng)
    tried = attempt(simulator, points, splines, NEXT_ACTION, state, observe)
    return points, int(tried.success.sum())


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


def _random_pulls(points: Floats, rng: np.random.Generator) -> Floats:
    """Splines (PULLS, 6) that draw the head of a rope (V, 3) away, about where it points."""
    outward = points[0, :2] - points[2, :2]
    angle = np.arctan2(outward[1], outward[0]) + rng.normal(0.0, 0.8, PULLS)
    distance = rng.uniform(0.05, 0.3, PULLS)[:, None]
    end = points[0, :2] + distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = (points[0, :2] + end) / 2
    height = np.full(PULLS, 0.05)  # low, so that no other strand is lifted
    return clip_splines(np.column_stack([np.zeros(PULLS), middle, height, end]))


def select_best_pull(ropes: Sequence[tuple[Floats, int] | None]) -> Floats:
    """The rope (V, 3) with the most successes of what `pull_head` returned; the first of equals.

    Raises:
        RuntimeError: there is none.
    """
    if pulled := [rope for rope in ropes if rope is not None]:
        return max(pulled, key=lambda rope: rope[1])[0]
    raise RuntimeError(
        f"no head could be pulled out to {LEAST_HEAD:g} m in {len(ropes)} knots; raise knots"
    )

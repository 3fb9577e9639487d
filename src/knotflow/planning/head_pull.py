"""A tied knot whose head is pulled out, in simulation, as the paper's authors did by hand
(Sec. VII-E)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from knotflow.simulation import Observer, RopeSimulator, attempt, clip_splines
from knotflow.topology import Arrange, Cross, TopologicalState, segment_intervals, segment_lengths
from knotflow.topology.polyline import Floats

PATH = "R1(0,1,1) C(0,1,1) C(2,0,1)"
"""The topological path that ties the knot, from a straight rope."""
NEXT_ACTION = Cross(0, 3, 1)
"""The action that the rope is to be ready for."""
LEAST_HEAD = 0.25
"""Length of rope from the head to the first crossing at which it is long enough, metres."""
LEAST_SEGMENT = 0.08
"""Length between neighbouring crossings from which on the loop is open, metres."""
PULLS, ROUNDS = 24, 24
"""Random pulls from which one is kept, and how often in succession at most."""


def pull_head(
    points: Floats,
    simulator: RopeSimulator,
    rng: np.random.Generator,
    observe: Observer | None = None,
) -> Floats | None:
    """A knotted rope (V, 3), metres, with its head pulled out and its loop opened.

    Of some random pulls, at the head and elsewhere, the one is kept that preserves the state and
    comes nearest to a head of `LEAST_HEAD` and segments of `LEAST_SEGMENT`, until both are reached;
    None where they are not.
    """
    state = TopologicalState.from_curve(points)

    def progress(rope: Floats) -> float:
        """How much of the wanted lengths the shortest one has; 1 or more is done."""
        head, *inner, _ = segment_lengths(rope) * simulator.config.rope.length
        return float(min(head / LEAST_HEAD, min(inner) / LEAST_SEGMENT))

    for _ in range(ROUNDS):
        if progress(points) >= 1:
            return points
        splines = _random_pulls(points, rng)
        pulls = attempt(simulator, points, splines, Arrange(NEXT_ACTION), state, observe)
        # The present rope comes first, and so is kept where no pull improves it.
        points = max([points, *pulls.rollouts.end_points[pulls.success]], key=progress)
    return None


def loop_area(points: Floats) -> float:
    """Area of the convex hull of a rope (V, 3) from its first crossing to its last, m^2."""
    inner = segment_intervals(points)[1:-1] * (len(points) - 1)
    loop = points[int(inner[0, 0]) : int(inner[-1, 1]) + 2, :2]
    return float(ConvexHull(loop).volume)  # of two dimensions, its area


def _random_pulls(points: Floats, rng: np.random.Generator) -> Floats:
    """Splines (PULLS, 6), half of which draw the head of a rope (V, 3) away, about where it points,
    and half any point in any direction."""
    half = PULLS // 2
    outward = points[0, :2] - points[2, :2]
    towards = np.arctan2(outward[1], outward[0]) + rng.normal(0.0, 0.8, half)
    angle = np.concatenate([towards, rng.uniform(-np.pi, np.pi, PULLS - half)])
    grasp = np.concatenate([np.zeros(half), rng.uniform(0.0, 1.0, PULLS - half)])
    reach = np.where(grasp == 0.0, 0.3, 0.15)
    distance = rng.uniform(0.02, reach)[:, None]
    begin = points[np.rint(grasp * (len(points) - 1)).astype(int), :2]
    end = begin + distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    height = np.full(PULLS, 0.03)  # low, so that no other strand is lifted
    return clip_splines(np.column_stack([grasp, (begin + end) / 2, height, end]))

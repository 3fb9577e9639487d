"""What a spline does to a rope, predicted without simulation: follow the leader.

Each link turns towards the one before and keeps its length; bending, sliding and buckling are left
out.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations.heuristic import arranging_splines, heuristic_splines
from knotflow.simulation import control_points, spline_path, state_or_none
from knotflow.topology import (
    Action,
    DegenerateCurveError,
    InvalidStateError,
    TopologicalState,
    project,
)
from knotflow.topology.polyline import Floats, planar_crossings

STEPS = 12
"""Steps in which a spline is followed."""
FALL = 0.02
"""Metres that a lifted rope falls from step to step where nothing holds it."""
SHORTEST_LOOP = 4
"""Links of the shortest loop that a stiff rope forms; smaller ones are ignored."""
SAME_CROSSING = 0.12
"""Shares of the rope's length that a crossing may move, in all, and still be the same."""
MOST_CROSSINGS = 8
"""States of more are not read."""
CANDIDATES, ARRANGING_CANDIDATES = 32, 16
"""Splines from which one is chosen."""


def predict_shapes(points: Floats, splines: Floats) -> Floats:
    """The shapes (N, V, 3) that N splines (N, 6) will give a rope (V, 3), metres."""
    points = np.asarray(points, dtype=np.float64)
    splines = np.asarray(splines, dtype=np.float64)
    vertices, count = len(points), len(splines)
    link = np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    floor = points[:, 2].min()
    path = spline_path(control_points(points, splines, floor), np.linspace(0, 1, STEPS + 1)[1:])
    path = np.concatenate([path, path]).transpose(1, 2, 0)  # (STEPS, 3, 2 N)
    # From the grasped vertex outward, towards the tail and towards the head; beyond either end
    # comes what is not of the rope.
    grasped = np.rint(splines[:, 0] * (vertices - 1)).astype(np.intp)
    away = np.arange(np.maximum(grasped, vertices - 1 - grasped).max(initial=0) + 1)[:, None]
    vertex = np.concatenate([grasped + away, grasped - away], axis=1)  # (V, 2 N)
    chain = points[np.clip(vertex, 0, vertices - 1)].swapaxes(1, 2).copy()  # (V, 3, 2 N)
    for held in path:
        chain[:, 2] = np.maximum(chain[:, 2] - FALL, floor)
        chain[0] = held
        for leader, follower in pairwise(chain):
            apart = follower - leader
            length = np.sqrt(np.einsum("kn,kn->n", apart, apart))
            follower[:] = leader + apart * (link / np.maximum(length, 1e-9))
    shape = np.empty((count, vertices, 3))
    steps, columns = np.nonzero((vertex >= 0) & (vertex < vertices))
    shape[columns % count, vertex[steps, columns]] = chain[steps, :, columns]
    return shape


def predict_states(points: Floats, splines: Floats) -> list[TopologicalState | None]:
    """The state that each of N splines (N, 6) will bring a rope (V, 3) to; None if unreadable.

    Where two strands cross as before, the same one stays on top; of new crossings it is the strand
    that moved farther.

    Raises:
        DegenerateCurveError: the state of the rope itself cannot be read.
    """
    shapes = predict_shapes(points, splines)
    before = project(points)
    known = np.array(  # (2c, 3): along either strand, and whether the first of them is over
        [
            (before.fractions[one - 1], before.fractions[other - 1], first_over)
            for over, under, _ in before.crossings
            for one, other, first_over in ((over, under, True), (under, over, False))
        ]
    ).reshape(-1, 3)
    moved = np.linalg.norm((shapes - points)[..., :2], axis=2)
    return [_state(*one, known) for one in zip(shapes[..., :2], moved, strict=True)]


def screened_splines(
    points: Floats,
    action: Action,
    count: int,
    rng: np.random.Generator,
    score: Callable[[Floats], Floats] | None = None,
) -> Floats:
    """Of many `heuristic_splines` those (count, 6) that are predicted to succeed.

    The `score` (N,) of splines (N, 6) decides among them, where it is given. A quarter, and all
    where none is predicted to succeed, are not screened.
    """
    splines = heuristic_splines(points, action, CANDIDATES * count, rng)
    goal = TopologicalState.from_curve(points).apply(action)
    promising = np.flatnonzero([state == goal for state in predict_states(points, splines)])
    return _select(splines, promising, splines, score, count, rng)


def screened_arranging_splines(
    points: Floats,
    action: Action,
    count: int,
    rng: np.random.Generator,
    score: Callable[[Floats], Floats],
) -> Floats:
    """Of many `arranging_splines` for a rope (V, 3) those (count, 6) that are predicted to keep
    its state and to leave the shapes (N, V, 3) of highest `score` (N,); a quarter are not screened.
    """
    splines = arranging_splines(points, action, ARRANGING_CANDIDATES * count, rng)
    state = TopologicalState.from_curve(points)
    shapes = predict_shapes(points, splines)
    # Which strand is on top is not predicted: one that hardly moves keeps its height.
    shapes[..., 2] = points[:, 2]
    kept = np.flatnonzero([state_or_none(shape) == state for shape in shapes])
    return _select(splines, kept, shapes, score, count, rng)


def _select(
    splines: Floats,
    good: NDArray[np.intp],
    scored: Floats,
    score: Callable[[Floats], Floats] | None,
    count: int,
    rng: np.random.Generator,
) -> Floats:
    """Splines (count, 6): `good` rows of N (N, 6), best score of `scored` (N, ...) first, and
    about a quarter others."""
    if score is not None and len(good):
        good = good[np.argsort(-score(scored[good]), kind="stable")]
    first = count - rng.binomial(count, 0.25)
    others = np.setdiff1d(np.arange(len(splines)), good)
    rows = np.concatenate([good[:first], others, np.sort(good[first:])])
    chosen: Floats = splines[rows[:count]]
    return chosen


def _state(xy: Floats, moved: Floats, known: Floats) -> TopologicalState | None:
    """The state of a predicted shape (V, 2) whose vertices moved by (V,) metres."""
    try:
        met = planar_crossings(xy)
    except DegenerateCurveError:  # an end that just touches a strand
        return None
    meet = np.flatnonzero(met.second - met.first >= SHORTEST_LOOP)
    if len(meet) > MOST_CROSSINGS:
        return None
    first, second = met.first[meet], met.second[meet]
    fractions = np.stack([first + met.first_along[meet], second + met.second_along[meet]], 1)
    fractions /= len(xy) - 1
    ranks = 1 + fractions.argsort(axis=None).argsort().reshape(-1, 2)
    first_over = moved[first] > moved[second]
    if len(known):
        apart = np.abs(fractions[:, None] - known[None, :, :2]).sum(2)  # (c, known)
        nearest = apart.argmin(1)
        same = apart[np.arange(len(meet)), nearest] < SAME_CROSSING
        first_over = np.where(same, known[nearest, 2] > 0, first_over)
    signs = np.where(first_over, 1, -1) * met.turn[meet].astype(int)
    over_under = np.where(first_over[:, None], ranks, ranks[:, ::-1])
    try:
        return TopologicalState.from_crossings(np.column_stack([over_under, signs]).tolist())
    except InvalidStateError:  # strands that are passed through
        return None

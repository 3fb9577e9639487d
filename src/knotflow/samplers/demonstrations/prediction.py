"""What a spline will do to a rope, predicted without simulating it.

A rope that is dragged over a table follows its leader: link after link turns towards the one before
and keeps its length. A hundred splines are predicted in the time that one is simulated, which is
enough to choose among guesses. It is a poor simulator: shapes are off by 40 mm in the mean (a rope
that is taken to lie still, by 64 mm), for bending, sliding and buckling are left out. But of 800
guesses at the actions that self-play finds hard 7 % succeeded, and of those that were predicted to
succeed 38 %.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from knotflow.samplers.demonstrations.aim import aim, rearrange
from knotflow.simulation import control_points, spline_basis, state_or_none
from knotflow.topology import (
    Action,
    DegenerateCurveError,
    InvalidStateError,
    TopologicalState,
    project,
)
from knotflow.topology.polyline import planar_crossings

STEPS = 12
"""Steps in which a spline is followed; more of them predict no better."""
FALL = 0.02
"""Metres that a lifted rope falls from step to step where nothing holds it."""
SHORTEST_LOOP = 4
"""Links; a stiff rope lays no loop of fewer, as followers do where the leader turns back."""
SAME_CROSSING = 0.12
"""Shares of the rope's length that a crossing may move along both of its strands, in all, and still
be the same, with the same strand on top."""
MOST_CROSSINGS = 8
"""Shapes of more are not read."""
GUESSES, MOVES = 32, 16
"""Guesses, and moves that may make room, from which one is chosen."""


def followed(points: NDArray, splines: NDArray) -> NDArray[np.float64]:
    """The shapes (N, V, 3) that N splines (N, 6) will give a rope (V, 3), metres."""
    points = np.asarray(points, dtype=np.float64)
    splines = np.asarray(splines, dtype=np.float64)
    vertices, count = len(points), len(splines)
    link = np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    floor = points[:, 2].min()
    path = spline_basis(np.linspace(0, 1, STEPS + 1)[1:]) @ control_points(points, splines, floor)
    path = np.concatenate([path, path]).transpose(1, 2, 0)  # (STEPS, 3, 2 N)
    # From the grasped vertex outward, towards the tail and towards the head; beyond either end
    # comes what is not of the rope.
    grasped = np.rint(splines[:, 0] * (vertices - 1)).astype(np.intp)
    away = np.arange(np.maximum(grasped, vertices - 1 - grasped).max(initial=0) + 1)[:, None]
    vertex = np.concatenate([grasped + away, grasped - away], axis=1)  # (V, 2 N)
    chain = points[np.clip(vertex, 0, vertices - 1)].swapaxes(1, 2).copy()  # (V, 3, 2 N)
    for places in path:
        chain[:, 2] = np.maximum(chain[:, 2] - FALL, floor)
        chain[0] = places
        for leader, follower in pairwise(chain):
            apart = follower - leader
            length = np.sqrt(np.einsum("kn,kn->n", apart, apart))
            follower[:] = leader + apart * (link / np.maximum(length, 1e-9))
    shape = np.empty((count, vertices, 3))
    steps, columns = np.nonzero((vertex >= 0) & (vertex < vertices))
    shape[columns % count, vertex[steps, columns]] = chain[steps, :, columns]
    return shape


def predicted_states(points: NDArray, splines: NDArray) -> list[TopologicalState | None]:
    """The state that each of N splines (N, 6) will bring a rope (V, 3) to.

    Where two strands cross as before, the same one stays on top; of new crossings it is the strand
    that was moved farther. None stands for shapes that are beyond reading.

    Raises:
        DegenerateCurveError: the state of the rope itself cannot be read.
    """
    shapes = followed(points, splines)
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


def aim_predicted(
    points: NDArray,
    action: Action,
    count: int,
    rng: np.random.Generator,
    worth: Callable[[NDArray], NDArray] | None = None,
) -> NDArray[np.float64]:
    """Of many guesses those (count, 6) that are predicted to succeed; otherwise as `aim`.

    Among these the `worth` (N,) of splines (N, 6) decides, where it is given. One of four is a
    guess as any other, and so are all where none is predicted to succeed: not all that succeeds is
    predicted.
    """
    guesses = aim(points, action, GUESSES * count, rng)
    goal = TopologicalState.from_curve(points).apply(action)
    promising = np.flatnonzero([state == goal for state in predicted_states(points, guesses)])
    return _chosen(guesses, promising, guesses, worth, count, rng)


def rearrange_predicted(
    points: NDArray,
    action: Action,
    count: int,
    rng: np.random.Generator,
    worth: Callable[[NDArray], NDArray],
) -> NDArray[np.float64]:
    """Of many moves of a rope (V, 3) that may make room for an action those (count, 6) that are
    predicted to keep its state and to leave the shapes (N, V, 3) of most `worth` (N,); one of four
    is as `rearrange` makes it."""
    moves = rearrange(points, action, MOVES * count, rng)
    state = TopologicalState.from_curve(points)
    shapes = followed(points, moves)
    # What lies on what is not followed: a strand that hardly moves keeps its height.
    shapes[..., 2] = points[:, 2]
    kept = np.flatnonzero([state_or_none(shape) == state for shape in shapes])
    return _chosen(moves, kept, shapes, worth, count, rng)


def _chosen(
    splines: NDArray,
    good: NDArray,
    judged: NDArray,
    worth: Callable[[NDArray], NDArray] | None,
    count: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Of splines (N, 6) those of the `good` rows that are of most worth by what is
    `judged` (N, ...), and about a quarter others: (count, 6)."""
    if worth is not None and len(good):
        good = good[np.argsort(-worth(judged[good]), kind="stable")]
    first = count - rng.binomial(count, 0.25)
    others = np.setdiff1d(np.arange(len(splines)), good)
    rows = np.concatenate([good[:first], others, np.sort(good[first:])])
    return splines[rows[:count]]


def _state(xy: NDArray, moved: NDArray, known: NDArray) -> TopologicalState | None:
    """The state of a predicted shape (V, 2), whose vertices moved so far (V,)."""
    try:
        met = planar_crossings(xy)
    except DegenerateCurveError:  # an end that just touches a strand
        return None
    meet = np.flatnonzero(met.second - met.first >= SHORTEST_LOOP)
    if len(meet) > MOST_CROSSINGS:
        return None
    first, second = met.first[meet], met.second[meet]
    places = np.stack([first + met.first_along[meet], second + met.second_along[meet]], 1)
    places /= len(xy) - 1
    ranks = np.empty(places.size, np.intp)
    ranks[np.argsort(places, axis=None)] = np.arange(1, places.size + 1)
    first_over = moved[first] > moved[second]
    if len(known):
        apart = np.abs(places[:, None] - known[None, :, :2]).sum(2)  # (c, known)
        nearest = apart.argmin(1)
        same = apart[np.arange(len(meet)), nearest] < SAME_CROSSING
        first_over = np.where(same, known[nearest, 2] > 0, first_over)
    signs = np.where(first_over, 1, -1) * met.turn[meet].astype(int)
    try:
        return TopologicalState.from_crossings(
            (one, other, sign) if over else (other, one, sign)
            for (one, other), over, sign in zip(
                ranks.reshape(-1, 2).tolist(), first_over.tolist(), signs.tolist(), strict=True
            )
        )
    except InvalidStateError:  # strands that are passed through
        return None

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

import numpy as np
from numpy.typing import NDArray

from knotflow.demonstrations.aim import aim, nudge
from knotflow.simulation import control_points, spline_basis, state_or_none
from knotflow.topology import Action, InvalidStateError, TopologicalState, project

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
GUESSES, NUDGES = 32, 8
"""Guesses, and small moves, from which one is chosen."""


def followed(points: NDArray, splines: NDArray) -> NDArray[np.float64]:
    """The shapes (N, V, 3) that N splines (N, 6) will give a rope (V, 3), metres."""
    splines = np.asarray(splines, dtype=np.float64)
    vertices = len(points)
    shape = np.repeat(np.asarray(points, dtype=np.float64)[None], len(splines), axis=0)
    link = np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    floor = points[:, 2].min()
    path = spline_basis(np.linspace(0, 1, STEPS + 1)[1:]) @ control_points(points, splines, floor)
    grasped = np.rint(splines[:, 0] * (vertices - 1)).astype(np.intp)
    rows = np.arange(len(splines))
    for step in range(STEPS):
        shape[:, :, 2] = np.maximum(shape[:, :, 2] - FALL, floor)
        shape[rows, grasped] = path[:, step]
        for side in (1, -1):
            leader = path[:, step]
            for away in range(1, vertices):
                follower = grasped + side * away
                there = rows[(follower >= 0) & (follower < vertices)]
                if not len(there):
                    break
                apart = shape[there, follower[there]] - leader[there]
                length = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-9)
                leader = leader.copy()
                leader[there] += apart * (link / length)
                shape[there, follower[there]] = leader[there]
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
    goal = project(points).state.apply(action)
    promising = np.flatnonzero([state == goal for state in predicted_states(points, guesses)])
    if worth is not None and len(promising):
        promising = promising[np.argsort(-worth(guesses[promising]), kind="stable")]
    return _chosen(guesses, promising, count, rng)


def nudge_predicted(
    points: NDArray,
    count: int,
    rng: np.random.Generator,
    worth: Callable[[NDArray], NDArray],
) -> NDArray[np.float64]:
    """Of many small moves of a rope (V, 3) those (count, 6) that are predicted to keep its state
    and to leave the shapes (N, V, 3) of most `worth` (N,); one of four is as `nudge` makes it."""
    moves = nudge(points, NUDGES * count, rng)
    state = project(points).state
    shapes = followed(points, moves)
    # What lies on what is not followed: a strand that hardly moves keeps its height.
    shapes[..., 2] = points[:, 2]
    kept = np.flatnonzero([state_or_none(shape) == state for shape in shapes])
    if len(kept):
        kept = kept[np.argsort(-worth(shapes[kept]), kind="stable")]
    return _chosen(moves, kept, count, rng)


def _chosen(
    splines: NDArray, best: NDArray, count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Of splines (N, 6) the first of the `best` rows, about a quarter others, `count` in all."""
    first = best[: count - rng.binomial(count, 0.25)]
    others = np.setdiff1d(np.arange(len(splines)), first)
    others = np.concatenate([np.setdiff1d(others, best), np.intersect1d(others, best)])
    return splines[np.concatenate([first, others[: count - len(first)]])]


def _state(xy: NDArray, moved: NDArray, known: NDArray) -> TopologicalState | None:
    """The state of a predicted shape (V, 2), whose vertices moved so far (V,)."""
    links = len(xy) - 1
    along = np.diff(xy, axis=0)
    first, second = np.triu_indices(links, SHORTEST_LOOP)
    between = xy[second] - xy[first]
    turn = _cross(along[first], along[second])
    with np.errstate(divide="ignore", invalid="ignore"):
        on_first = _cross(between, along[second]) / turn
        on_second = _cross(between, along[first]) / turn
    meet = np.flatnonzero((on_first >= 0) & (on_first < 1) & (on_second >= 0) & (on_second < 1))
    if len(meet) > MOST_CROSSINGS:
        return None
    places = np.stack([first[meet] + on_first[meet], second[meet] + on_second[meet]], 1) / links
    ranks = np.empty(places.size, np.intp)
    ranks[np.argsort(places, axis=None)] = np.arange(1, places.size + 1)
    first_over = moved[first[meet]] > moved[second[meet]]
    if len(known):
        apart = np.abs(places[:, None] - known[None, :, :2]).sum(2)  # (c, known)
        nearest = apart.argmin(1)
        same = apart[np.arange(len(meet)), nearest] < SAME_CROSSING
        first_over = np.where(same, known[nearest, 2] > 0, first_over)
    signs = np.where(first_over, 1, -1) * np.where(turn[meet] > 0, 1, -1)
    try:
        return TopologicalState.from_crossings(
            (one, other, sign) if over else (other, one, sign)
            for (one, other), over, sign in zip(
                ranks.reshape(-1, 2).tolist(), first_over.tolist(), signs.tolist(), strict=True
            )
        )
    except InvalidStateError:  # strands that are passed through
        return None


def _cross(one: NDArray, other: NDArray) -> NDArray:
    crossed: NDArray = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return crossed

"""A heuristic for splines: the strategy of human demonstrators (Sec. V-A).

"When making a new intersection, humans will grasp the segment that will be over the newly formed
intersection, and move towards the segment that will be underneath." Positions are drawn at random.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from knotflow.samplers.sampler import NoSettings, sampler
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW, clip_splines
from knotflow.topology import (
    R1,
    R2,
    Action,
    Arrange,
    Cross,
    TopologicalState,
    Undo,
    segment_intervals,
)
from knotflow.topology.polyline import Floats, interpolate

TIP = 0.15
"""Share of an end segment, counted from the rope's end, in which an end is grasped or covered."""

UNDO_MARGIN = 0.1
"""Share of the rope's length beyond a segment within which it is grasped, too, to undo."""


def heuristic_splines(
    points: Floats, action: Action, count: int, rng: np.random.Generator
) -> Floats:
    """Splines (count, 6) in range that are likely to do an action of a rope (V, 3), metres."""
    if isinstance(action, Arrange):
        return small_moves(points, count, rng)
    segments = segment_intervals(points)
    if isinstance(action, Undo):
        return _drags(points, segments[action.pulled_segment(len(segments))], count, rng)
    grasp, target = _grasp_and_target(action, segments, count, rng)
    passed = _at(points, target)
    along = _at(points, target + 0.01) - _at(points, target - 0.01)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    if side := _side(action, len(segments)):
        toward = side * left
    else:  # the action leaves the direction open: straight from grasp to target
        toward = passed - _at(points, grasp) + rng.normal(0, 0.05, (count, 2))
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    if _covers_end(action, len(segments)):
        # Half of the bights go over the tip and on in its direction, so that they lie around it.
        outward = along if action.under_segment else -along
        toward = np.where(rng.random((count, 1)) < 0.5, outward, toward)
    turn = rng.normal(0, 0.4, count)
    cos, sin = np.cos(turn), np.sin(turn)
    toward = np.stack(
        [cos * toward[:, 0] - sin * toward[:, 1], sin * toward[:, 0] + cos * toward[:, 1]], axis=1
    )
    end = passed + rng.uniform(0.02, 0.12, (count, 1)) * toward
    # The path arrives from the middle control point.
    mid = end - rng.uniform(0.05, 0.4, (count, 1)) * toward + rng.normal(0, 0.03, (count, 2))
    height = rng.uniform(0.03, 0.12, count)
    return clip_splines(np.column_stack([grasp, mid, height, end]))


def heuristic_any_action(
    points: Floats,
    state: TopologicalState,
    rng: np.random.Generator,
    random_share: float = 0.0,
    most_crossings: int | None = None,
) -> Floats:
    """A heuristic spline (6,) for a random action of a rope (V, 3) in a state.

    With probability `random_share`, or where each action leads to more than `most_crossings`, it
    is uniformly random.
    """
    actions = [
        action
        for action, after in state.actions()
        if most_crossings is None or after.num_crossings <= most_crossings
    ]
    if not actions or (random_share and rng.random() < random_share):
        return rng.uniform(SPLINE_LOW, SPLINE_HIGH)
    (spline,) = heuristic_splines(points, actions[rng.integers(len(actions))], 1, rng)
    return np.asarray(spline)


def _grasp_and_target(
    action: Action, segments: Floats, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Where to grasp and what to pass over, fractions (count,) of the rope's length."""
    over, under = segments[action.over_segment], segments[action.under_segment]
    one, other = rng.uniform(0, 1, (2, count))
    if isinstance(action, Cross):
        if _covers_end(action, len(segments)):
            one = 0.1 + 0.8 * one
            other = 2 * TIP * other if action.under == 0 else 1 - 2 * TIP * other
        else:
            one = TIP * one if action.over == 0 else 1 - TIP * one
    elif action.over_segment == action.under_segment:
        # A segment over itself: grasp and target lie at least a third of it apart.
        near, far = one / 3, 2 / 3 + other / 3
        if isinstance(action, R2):
            first_is_over = action.over_first == 1
        else:  # a loop on the left turns the second passage to the right of the first, see Eq. 1
            first_is_over = isinstance(action, R1) and action.left * action.sign == -1
        one, other = (near, far) if first_is_over else (far, near)
    return over[0] + one * np.diff(over), under[0] + other * np.diff(under)


def _covers_end(action: Action, num_segments: int) -> bool:
    """Whether a segment that is no end covers an end."""
    return isinstance(action, Cross) and action.over not in (0, num_segments - 1)


def _side(action: Action, num_segments: int) -> int:
    """Whether the under segment is passed towards its left (+1), its right (-1), or either (0)."""
    if isinstance(action, Cross):
        # Eq. 1 with the over strand moving to the left: -1 where the rope runs with the motion
        # (the tail end), +1 where it runs against it (the head end).
        return {0: action.sign, num_segments - 1: -action.sign}.get(action.over, 0)
    if isinstance(action, R1 | R2) and action.over_segment == action.under_segment:
        return -action.left
    return 0


def _at(points: Floats, fraction: Floats) -> Floats:
    """Positions (N, 2) on the table at fractions (N,) of the rope's length."""
    along = np.linspace(0, 1, len(points))
    fraction = np.clip(fraction, 0, 1)
    return interpolate(fraction, along, points[:, :2])


def _around(
    positions: Floats, least: Floats | float, most: Floats | float, rng: np.random.Generator
) -> Floats:
    """Points (N, 2) in random directions from positions (N, 2), `least` to `most` metres off."""
    angle = rng.uniform(-np.pi, np.pi, len(positions))
    distance = rng.uniform(least, most, len(positions))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(positions + distance[:, None] * direction)


def _drags(points: Floats, segment: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Drags (count, 6) in random directions of a segment (2,) and `UNDO_MARGIN` beyond it."""
    low, high = max(segment[0] - UNDO_MARGIN, 0.0), min(segment[1] + UNDO_MARGIN, 1.0)
    grasp = rng.uniform(low, high, count)
    begin = _at(points, grasp)
    end = _around(begin, 0.1, 0.5, rng)
    mid = (begin + end) / 2 + rng.normal(0, 0.03, (count, 2))
    return clip_splines(np.column_stack([grasp, mid, rng.uniform(0.04, 0.2, count), end]))


def small_moves(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Small random moves (count, 6) of a rope (V, 3), most of which keep its state."""
    grasp = rng.uniform(0, 1, count)
    begin = _at(points, grasp)
    end = begin + rng.normal(0, 0.08, (count, 2))
    mid = (begin + end) / 2 + rng.normal(0, 0.03, (count, 2))
    return clip_splines(np.column_stack([grasp, mid, rng.uniform(0.03, 0.15, count), end]))


def arranging_splines(
    points: Floats, action: Action, count: int, rng: np.random.Generator
) -> Floats:
    """Moves (count, 6) of a rope (V, 3) that may make an action easier.

    A point on one of the action's two segments, or the rope's tip where that is an end, is pulled
    in a random direction or next to the other segment; a quarter are `small_moves`.
    """
    segments = segment_intervals(points)
    if isinstance(action, Undo):
        about = np.full(2, action.pulled_segment(len(segments)))
    else:
        about = np.array([action.over_segment, action.under_segment])
    which = rng.integers(2, size=count)
    own, other = about[which], segments[about[1 - which]]
    side, along = rng.random((2, count))
    along = np.where((own == 0) & (side < 0.5), TIP * along, along)
    along = np.where((own == len(segments) - 1) & (side > 0.5), 1 - TIP * along, along)
    grasp = segments[own, 0] + along * (segments[own, 1] - segments[own, 0])
    begin = _at(points, grasp)
    beside = (about[0] != about[1]) & (rng.random(count) < 0.5)
    origin = np.where(beside[:, None], _at(points, rng.uniform(other[:, 0], other[:, 1])), begin)
    end = _around(origin, np.where(beside, 0.02, 0.03), np.where(beside, 0.1, 0.15), rng)
    mid = (begin + end) / 2 + rng.normal(0, 0.05, (count, 2))
    moves = clip_splines(np.column_stack([grasp, mid, rng.uniform(0.03, 0.2, count), end]))
    small = count // 4
    return np.concatenate([moves[: count - small], small_moves(points, small, rng)])


class AimedSampler:
    """`heuristic_splines` as a sampler: no baseline of the paper."""

    def sample(
        self, points: Floats, action: Action, count: int, rng: np.random.Generator
    ) -> Floats:
        return heuristic_splines(points, action, count, rng)


@sampler("aimed")
def build(config: NoSettings, inputs: Mapping[str, Path]) -> AimedSampler:
    """Requires no input."""
    return AimedSampler()

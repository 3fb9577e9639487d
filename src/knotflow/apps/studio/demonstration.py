"""Ropes and splines from clicks: a drawn rope, and a demonstration in three clicks.

A click is a ray from the camera into the scene: on the rope it means the strand on top, on the
table the point where the ray meets it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.planning import RopeInputError, lay_down
from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeConfig,
    check_splines,
    control_points,
)
from knotflow.topology import Action, TopologicalState
from knotflow.topology.polyline import arc_lengths, interpolate

CLICKS = ("grasp", "middle", "end")
CLICK_RADIUS = 0.03  # metres from the rope's centre line within which a click grasps it
HEIGHTS = (float(SPLINE_LOW[3]), float(SPLINE_HIGH[3]))  # of the middle control point, metres
_FINENESS = 0.001  # of the rope's length: resolution of a grasp
_SLOPE = 0.1  # rise per length of a drawn rope, so that a later strand is over an earlier one
_SMOOTHING = 4  # rounds of corner cutting: bends of a polyline become those of a rope


class ClickError(ValueError):
    """A click that means nothing here."""


@dataclass
class Draft:
    """A demonstration in the making: up to three clicks for an action on a rope."""

    points: NDArray[np.float64]  # (V, 3) the rope at rest, metres
    state: TopologicalState
    action: Action  # legal in the state
    rope: RopeConfig
    height: float = 0.15  # of the middle control point, metres above the table
    clicks: list[tuple[float, ...]] = field(default_factory=list)  # (grasp,), (x, y), (x, y), m

    @property
    def goal(self) -> TopologicalState:
        """The state in which the demonstration succeeds."""
        return self.state.apply(self.action)

    @property
    def next_click(self) -> str | None:
        """Which of `CLICKS` comes next; None after the third."""
        return CLICKS[len(self.clicks)] if len(self.clicks) < len(CLICKS) else None

    @property
    def spline(self) -> NDArray[np.float64]:
        """(6,) the demonstrated spline, after three clicks."""
        if self.next_click is not None:
            raise ClickError(f"the spline is not complete: click the {self.next_click} first")
        (grasp,), middle, end = self.clicks
        return check_splines(np.array([grasp, *middle, self.height, *end]))

    @property
    def controls(self) -> NDArray[np.float64]:
        """(n, 3) the control points clicked so far, metres."""
        clicks = [*self.clicks, *[(0.0, 0.0)] * (len(CLICKS) - len(self.clicks))]
        spline = np.array([clicks[0][0], *clicks[1], self.height, *clicks[2]])
        return control_points(self.points, spline, self.rope.radius)[: len(self.clicks)]

    def click(self, origin: ArrayLike, direction: ArrayLike) -> None:
        """Take the next click: a ray from `origin` (3,), metres, world frame, along a direction."""
        if self.next_click is None:
            raise ClickError("all three points are set: simulate them, or undo one")
        if self.next_click == "grasp":
            self.clicks.append((grasp_at(self.points, origin, direction),))
            return
        x, y = table_point(origin, direction, self.rope.radius)
        low, high = SPLINE_LOW[4:], SPLINE_HIGH[4:]
        if not ((low <= (x, y)) & ((x, y) <= high)).all():
            raise ClickError(
                f"the {self.next_click} at x {x:+.2f}, y {y:+.2f} m is out of the gripper's reach "
                f"of {high[0]:g} m"
            )
        self.clicks.append((x, y))

    def undo(self) -> None:
        del self.clicks[-1:]


def grasp_at(points: NDArray, origin: ArrayLike, direction: ArrayLike) -> float:
    """Where on a rope (V, 3) a ray hits first, as a fraction of its length from the head."""
    origin, along = np.asarray(origin, float), _unit(direction)
    fractions = np.arange(0.0, 1.0 + _FINENESS / 2, _FINENESS).clip(0.0, 1.0)
    links = np.linspace(0.0, 1.0, len(points))
    rope = interpolate(fractions, links, points)
    depth = (rope - origin) @ along
    distance = np.linalg.norm(rope - origin - depth[:, None] * along, axis=1)
    if distance.min() > CLICK_RADIUS:
        raise ClickError(
            f"grasp the rope: that was {distance.min() * 100:.0f} cm beside it, at most "
            f"{CLICK_RADIUS * 100:g} cm is allowed"
        )
    # Every strand under the cursor has a nearest point; the one on top is what one sees there.
    padded = np.r_[np.inf, distance, np.inf]
    nearest = (distance <= padded[:-2]) & (distance <= padded[2:])
    strands = np.flatnonzero(nearest & (distance <= distance.min() + 0.004))
    return float(fractions[strands[depth[strands].argmin()]])


def table_point(
    origin: ArrayLike, direction: ArrayLike, height: float = 0.0
) -> tuple[float, float]:
    """Where a ray meets the plane at a height above the table, metres (x, y)."""
    origin, along = np.asarray(origin, float), _unit(direction)
    reach = (height - origin[2]) / along[2] if along[2] else -1.0
    if reach <= 0.0:
        raise ClickError("that is above the horizon: click on the table")
    x, y = (origin + reach * along)[:2].tolist()
    return x, y


def rope_from_drawing(clicked: ArrayLike, rope: RopeConfig) -> NDArray[np.float64]:
    """A rope (V, 3) at rest along a polyline (N, 2) on the table, metres, head first.

    The drawing is smoothed, scaled to the rope's length and centred; later strands lie on top.

    Raises:
        RopeInputError: the drawing is too short, too small, too sharp or too dense.
    """
    corners = np.asarray(clicked, np.float64).reshape(-1, 2)
    if len(corners) < 2:
        raise RopeInputError("a drawn rope needs at least two points: click on the table")
    for _ in range(_SMOOTHING):  # Chaikin
        ahead, behind = corners[:-1], corners[1:]
        cut = np.stack([0.75 * ahead + 0.25 * behind, 0.25 * ahead + 0.75 * behind], axis=1)
        corners = np.concatenate([corners[:1], cut.reshape(-1, 2), corners[-1:]])
    reached = arc_lengths(corners)
    drawn = float(reached[-1])
    if drawn < 0.2 * rope.length:
        raise RopeInputError(f"the drawing is {drawn:.2f} m long, the rope {rope.length:g} m")
    curve = np.column_stack([corners, _SLOPE * reached]) * rope.length / drawn
    curve[:, :2] -= (curve[:, :2].min(axis=0) + curve[:, :2].max(axis=0)) / 2
    points = lay_down(curve, rope)
    if np.abs(points[:, :2]).max() > SPLINE_HIGH[-1]:
        raise RopeInputError(f"stretched to {rope.length:g} m it would leave the gripper's reach")
    return points


def _unit(direction: ArrayLike) -> NDArray[np.float64]:
    vector = np.asarray(direction, float)
    return vector / np.linalg.norm(vector)

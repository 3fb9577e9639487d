"""A demonstration in the making: three clicks, as the paper's demonstrators made them.

They say where to grasp the rope, where the middle control point is, and where to let go. A click is
a ray from the eye into the scene: on the rope it finds what is seen first, on the table where the
ray meets it. The middle's height comes from a slider.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    RopeConfig,
    check_splines,
    control_points,
)
from knotflow.topology import Action, TopologicalState

CLICKS = ("grasp", "middle", "end")
NEAR = 0.03
"""Metres from the rope's centre line within which a click is meant for it."""
HEIGHTS = (float(SPLINE_LOW[3]), float(SPLINE_HIGH[3]))
"""Lowest and highest middle control point, metres above the table."""
_FINE = 0.001  # of the rope's length: between the places that a click may mean


class ClickError(ValueError):
    """A click that means nothing here."""


@dataclass
class Draft:
    """Up to three clicks for an action on a rope.

    Attributes:
        points: (V, 3) the rope at rest, metres.
        state: its topological state.
        action: what is demonstrated; legal in the state.
        rope: its radius.
        height: of the middle control point, metres above the table.
        places: what was clicked, as parts of a spline: (grasp,), (x, y), (x, y).
    """

    points: NDArray[np.float64]
    state: TopologicalState
    action: Action
    rope: RopeConfig
    height: float = 0.15
    places: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def goal(self) -> TopologicalState:
        """The state in which the demonstration succeeds."""
        return self.state.apply(self.action)

    @property
    def awaits(self) -> str | None:
        """Which of `CLICKS` comes next; None after the third."""
        return CLICKS[len(self.places)] if len(self.places) < len(CLICKS) else None

    @property
    def spline(self) -> NDArray[np.float64]:
        """(6,) the demonstrated spline.

        Raises:
            ClickError: there are fewer than three clicks.
        """
        if self.awaits is not None:
            raise ClickError(f"the spline is not complete: click the {self.awaits} first")
        (grasp,), middle, end = self.places
        return check_splines(np.array([grasp, *middle, self.height, *end]))

    @property
    def controls(self) -> NDArray[np.float64]:
        """(n, 3) the control points clicked so far, metres."""
        places = [*self.places, *[(0.0, 0.0)] * (len(CLICKS) - len(self.places))]
        grasp = places[0][0] if self.places else 0.0
        spline = np.array([grasp, *places[1], self.height, *places[2]])
        return control_points(self.points, spline, self.rope.radius)[: len(self.places)]

    def click(self, origin: ArrayLike, direction: ArrayLike) -> None:
        """Take the next click: a ray from `origin` (3,), metres, world frame, along a direction.

        Raises:
            ClickError: it misses the rope, or the table within a spline's reach; or all three
                were made already.
        """
        if self.awaits is None:
            raise ClickError("all three points are set: simulate them, or undo one")
        if self.awaits == "grasp":
            self.places.append((place_on_rope(self.points, origin, direction),))
            return
        x, y = place_on_table(origin, direction, self.rope.radius)
        low, high = SPLINE_LOW[4:], SPLINE_HIGH[4:]
        if not ((low <= (x, y)) & ((x, y) <= high)).all():
            raise ClickError(
                f"the {self.awaits} at x {x:+.2f}, y {y:+.2f} m is out of the gripper's reach of "
                f"{high[0]:g} m"
            )
        self.places.append((x, y))

    def undo(self) -> None:
        """Take the last click back, if there is one."""
        del self.places[-1:]


def place_on_rope(points: NDArray, origin: ArrayLike, direction: ArrayLike) -> float:
    """Where on a rope (V, 3) a ray hits first, as a fraction of its length from the head.

    Raises:
        ClickError: the ray passes the rope by more than `NEAR`.
    """
    origin, along = np.asarray(origin, float), _unit(direction)
    fractions = np.arange(0.0, 1.0 + _FINE / 2, _FINE).clip(0.0, 1.0)
    links = np.linspace(0.0, 1.0, len(points))
    rope = np.column_stack([np.interp(fractions, links, column) for column in points.T])
    depth = (rope - origin) @ along
    apart = np.linalg.norm(rope - origin - depth[:, None] * along, axis=1)
    if apart.min() > NEAR:
        raise ClickError(
            f"grasp the rope: that was {apart.min() * 100:.0f} cm beside it, {NEAR * 100:g} cm at "
            "most is meant for it"
        )
    # Every strand under the cursor has a nearest place; the strand on top is what one sees there.
    padded = np.r_[np.inf, apart, np.inf]
    nearest = (apart <= padded[:-2]) & (apart <= padded[2:])
    meant = np.flatnonzero(nearest & (apart <= apart.min() + 0.004))
    return float(fractions[meant[depth[meant].argmin()]])


def place_on_table(
    origin: ArrayLike, direction: ArrayLike, height: float = 0.0
) -> tuple[float, float]:
    """Where a ray meets the plane at a height above the table, metres (x, y).

    Raises:
        ClickError: it does not.
    """
    origin, along = np.asarray(origin, float), _unit(direction)
    reach = (height - origin[2]) / along[2] if along[2] else -1.0
    if reach <= 0.0:
        raise ClickError("that is above the horizon: click on the table")
    x, y = (origin + reach * along)[:2].tolist()
    return x, y


def _unit(direction: ArrayLike) -> NDArray[np.float64]:
    vector = np.asarray(direction, float)
    return vector / np.linalg.norm(vector)

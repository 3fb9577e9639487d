"""From a plan to timed gripper waypoints that a robot executes (Sec. VI).

For each spline the gripper travels above the grasp point, descends on it, closes, drags the rope
along the spline, timed as it was simulated or slower, opens on the table, and rises.

Positions are of the grasped point of the rope's centre line, metres, world frame. Every phase takes
a whole number of sampling intervals, rounded up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.fingers import HandConfig, openings
from knotflow.planning.frame import METRES, Frame
from knotflow.simulation import grasped_link
from knotflow.topology import Action
from knotflow.topology.polyline import Floats

UPRIGHT = 0.99
"""Cosine of the largest angle between z and a table's normal at which a yaw about z says how the
fingers close."""


@dataclass
class GripperConfig:
    """How the gripper moves when it does not hold the rope."""

    approach_height: float = 0.15
    """Height above the table from which the gripper comes down on the rope, metres."""
    retreat_height: float = 0.15
    """Height above the table to which it rises after letting go, metres."""
    clearance: float = 0.03
    """Least distance from the top of the resting rope while it travels, metres."""
    travel_speed: float = 0.25
    """Highest speed between splines, metres per second."""
    vertical_speed: float = 0.10
    """Highest speed down to the rope and up from it, metres per second."""
    drag_speed: float = np.inf
    """Highest speed while it holds the rope, metres per second: where the simulated motion is
    faster, it is slowed as a whole. The default keeps the simulated timing."""
    lowest: float = 0.0
    """Least height above the table while it drags, for fingers that reach beyond their tool point,
    metres. Drags that come lower are raised as a whole."""
    close_time: float = 0.5
    """Time to close on the rope, seconds."""
    open_time: float = 0.5
    """Time to let go of it, seconds."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name.endswith("_speed") and not value > 0.0:
                raise ValueError(f"gripper.{name} must be above 0 m/s, got {value}")
            if name.endswith("_time") and not value >= 0.0:
                raise ValueError(f"gripper.{name} must be 0 s or more, got {value}")

    def clear_of(self, shapes: Floats, radius: float) -> GripperConfig:
        """This configuration, its heights raised where ropes (..., V, 3) of a radius, metres, lie
        higher."""
        least = max(_top(shapes, radius) + self.clearance, self.lowest)
        approach, retreat = max(self.approach_height, least), max(self.retreat_height, least)
        return replace(self, approach_height=approach, retreat_height=retreat)


@dataclass(frozen=True, eq=False)
class Waypoints:
    """N timed waypoints, evenly spaced.

    Attributes:
        times: (N,) seconds from the beginning.
        positions: (N, 3) of the gripper, metres, world frame.
        yaws: (N,) direction of the strand across which the fingers close in that step, radians
            about z from x; while they hold the rope they may turn freely.
        closed: (N,) whether the gripper is commanded to be closed.
        openings: (N,) distance between the fingers, metres: when open as wide as neighbouring
            strands allow where they grasp or let go, see `fingers.openings`; when closed 0.
        step: (N,) index of the plan's step that the waypoint belongs to.
        actions: (N,) that step's action as text.
        phases: (N,) travel, descend, close, drag, open or rise.
    """

    times: Floats
    positions: Floats
    yaws: Floats
    closed: NDArray[np.bool_]
    openings: Floats
    step: NDArray[np.int64]
    actions: tuple[str, ...]
    phases: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.times)

    def to_csv(self, file: Path | StringIO, frame: Frame | None = None) -> None:
        """Write a row a waypoint: time_s, x_m, y_m, z_m, yaw_rad, opening_m, closed (0 or 1), step,
        action and phase.

        Positions and yaws are in the `frame`, lengths in its unit, which the columns name. Where
        z is not the table's normal there, the strand's direction, strand_x, strand_y and strand_z,
        stands in place of yaw_rad.
        """
        import pandas as pd  # slow to import

        frame = frame or Frame()
        columns = [f"{axis}_{frame.unit}" for axis in "xyz"]
        table = pd.DataFrame(frame.to_file(self.positions), columns=columns)
        table.insert(0, "time_s", self.times)
        strands = np.stack([np.cos(self.yaws), np.sin(self.yaws), 0 * self.yaws], axis=1)
        x, y, z = (strands @ frame.rotation.T).T
        if abs(frame.rotation[2, 2]) > UPRIGHT:
            table["yaw_rad"] = np.arctan2(y, x)
        else:
            table = table.assign(strand_x=x, strand_y=y, strand_z=z)
        table[f"opening_{frame.unit}"] = self.openings / METRES[frame.unit]
        table = table.assign(closed=self.closed.astype(int), step=self.step)
        table = table.assign(action=self.actions, phase=self.phases)
        table.to_csv(file, index=False, float_format="%.6f", lineterminator="\r\n")


class Drag(Protocol):
    """What waypoints need to know of a `PlanStep`."""

    @property
    def action(self) -> Action: ...
    @property
    def spline(self) -> Floats: ...
    @property
    def times(self) -> Floats: ...
    @property
    def gripper(self) -> NDArray[np.float32]: ...
    @property
    def release_time(self) -> float: ...


def trace_waypoints(
    steps: Sequence[Drag],
    shapes: Floats,
    radius: float,
    rate_hz: float,
    config: GripperConfig,
) -> Waypoints:
    """The waypoints of a plan.

    Args:
        steps: n of them.
        shapes: (n + 1, V, 3) the rope at rest before, between and after, metres.
        radius: of the rope, metres.
        rate_hz: waypoints per second.
        config: heights and speeds.

    Raises:
        ValueError: a rate that is not above 0, or heights too low to pass above the rope.
    """
    if not rate_hz > 0.0:
        raise ValueError(f"the rate must be above 0 Hz, got {rate_hz}")
    top = _top(shapes, radius)
    for name in ("approach_height", "retreat_height"):
        if not (height := getattr(config, name)) >= top + config.clearance:
            raise ValueError(
                f"gripper.{name} is {height:g} m, but the rope lies up to {top:.3f} m high and "
                f"gripper.clearance is {config.clearance:g} m: take at least "
                f"{top + config.clearance:.3f} m"
            )
    rows: list[tuple[Floats, int, str, str, float]] = []
    hand, wide = HandConfig(), 0.0
    least = 2 * (radius + hand.clearance)
    links = shapes.shape[1] - 1
    grasped = [int(grasped_link(step.spline, links)) for step in steps]
    strands = np.array(
        [shape[link + 1] - shape[link] for shape, link in zip(shapes, grasped, strict=False)]
    ).reshape(-1, 3)
    for number, step in enumerate(steps):
        path = _drag(step, rate_hz, config.drag_speed)
        path[:, 2] += max(config.lowest - float(path[:, 2].min()), 0.0)
        here = rows[-1][0] if rows else None
        before, after = (
            max(float(openings(shape, [grasped[number]], radius, hand)[0]), least)
            for shape in shapes[number : number + 2]
        )
        wide = wide or before
        targets = {"travel": before, "close": 0.0, "open": after}
        for phase, positions in _phases(here, path, rate_hz, config).items():
            target, count = targets.get(phase, wide), len(positions)
            ramp = wide + (target - wide) * np.arange(1, count + 1) / max(count, 1)
            rows += [
                (place, number, str(step.action), phase, width)
                for place, width in zip(positions, ramp.tolist(), strict=True)
            ]
            wide = target
    step_of = np.array([row[1] for row in rows], np.int64)
    return Waypoints(
        times=np.arange(len(rows)) / rate_hz,
        positions=np.array([row[0] for row in rows]).reshape(-1, 3),
        yaws=np.arctan2(strands[:, 1], strands[:, 0])[step_of],
        closed=np.array([row[3] in ("close", "drag") for row in rows], bool),
        openings=np.array([row[4] for row in rows]),
        step=step_of,
        actions=tuple(row[2] for row in rows),
        phases=tuple(row[3] for row in rows),
    )


def _top(shapes: Floats, radius: float) -> float:
    """The highest point of ropes (..., V, 3), metres."""
    return float(shapes[..., 2].max()) + radius


def _phases(
    here: Floats | None, drag: Floats, rate_hz: float, config: GripperConfig
) -> dict[str, Floats]:
    """Positions (N, 3) in each phase of a step with a drag (n + 1, 3), from `here` (3,)."""
    grasp, release = drag[0], drag[-1]
    above = np.array([*grasp[:2], config.approach_height])
    up = np.array([*release[:2], config.retreat_height])
    return {
        "travel": above[None] if here is None else _move(here, above, config.travel_speed, rate_hz),
        "descend": _move(above, grasp, config.vertical_speed, rate_hz),
        "close": np.tile(grasp, (_intervals(config.close_time, rate_hz), 1)),
        "drag": drag[1:],
        "open": np.tile(release, (_intervals(config.open_time, rate_hz), 1)),
        "rise": _move(release, up, config.vertical_speed, rate_hz),
    }


def _drag(step: Drag, rate_hz: float, speed: float) -> Floats:
    """The gripper path (T, 3) at n + 1 even times, slowed as a whole to `speed` at most."""
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    gripper = np.asarray(step.gripper, np.float64)
    slope = np.gradient(gripper, step.times, axis=0)
    slope[[0, -1]] = 0.0  # it starts and ends at rest
    curve = CubicHermiteSpline(step.times, gripper, slope)
    count = _intervals(step.release_time, rate_hz)
    while True:  # a finer look may find a slightly higher peak
        path: Floats = curve(np.linspace(0.0, step.release_time, count + 1))
        path[-1] = gripper[-1]  # where it lets go, whether or not a frame falls on that moment
        peak = float(np.linalg.norm(np.diff(path, axis=0), axis=1).max()) * rate_hz
        if peak <= speed:
            return path
        count = max(count + 1, _intervals(count / rate_hz * peak / speed, rate_hz))


def _move(begin: Floats, end: Floats, speed: float, rate_hz: float) -> Floats:
    """Positions (n, 3) along a straight line from rest to rest, `begin` left out."""
    # The smooth step 3u^2 - 2u^3 is at most 1.5 times as fast as its mean.
    count = _intervals(1.5 * float(np.linalg.norm(end - begin)) / speed, rate_hz)
    u = np.linspace(0.0, 1.0, count + 1)[1:, None]
    return begin + u**2 * (3.0 - 2.0 * u) * (end - begin)


def _intervals(seconds: float, rate_hz: float) -> int:
    """At least one; 1.8 s at 10 Hz are 18 intervals in spite of rounding."""
    return max(1, int(np.ceil(seconds * rate_hz - 1e-9)))

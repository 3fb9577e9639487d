"""Worlds: how far the real rope and the robot's motion may differ from the planner's model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from knotflow.simulation.rope import RopeConfig
from knotflow.topology.polyline import Floats

LEVELS = (0, 1, 2)
"""0 is the planner's rope, 1 a similar one, 2 a different one."""

EXPONENTS = {
    "table_friction": 0.4,
    "rope_friction": 0.4,
    "joint_damping": 0.4,
    "joint_stiffness": 0.7,
    "density": 0.3,
    "radius": 0.1,
}
"""Fields of `RopeConfig` -> a: at level n the value is multiplied by e^u, u uniform in
[-n a, n a]."""

GRIPPER_ERROR_STD = (0.0, 0.006, 0.010)
"""Standard deviation of the gripper's position in x and y at each level, metres."""

GRASP_REACH = 0.025
"""Largest distance from the fingers to a centre line that they catch when closing, metres: half
their opening."""


def perturb_rope(rope: RopeConfig, level: int, rng: np.random.Generator) -> RopeConfig:
    """A rope whose `EXPONENTS` fields are drawn log-uniformly around those of `rope`.

    Raises:
        ValueError: for an unknown level.
    """
    _check_level(level)
    factors = {name: np.exp(level * a * rng.uniform(-1, 1)) for name, a in EXPONENTS.items()}
    return replace(rope, **{name: getattr(rope, name) * f for name, f in factors.items()})


def _check_level(level: int) -> None:
    if level not in LEVELS:
        raise ValueError(f"unknown level {level!r}; valid levels: {', '.join(map(str, LEVELS))}")


def nearest_link(points: Floats, place: Floats) -> tuple[int, float]:
    """The link of a rope (V, 3) whose centre line is nearest to a place (3,), and its distance."""
    along = np.diff(points, axis=0)
    share = ((place - points[:-1]) * along).sum(1) / (along**2).sum(1)
    nearest = points[:-1] + np.clip(share, 0, 1)[:, None] * along
    distance = np.linalg.norm(nearest - place, axis=1)
    link = int(distance.argmin())
    return link, float(distance[link])


@dataclass(frozen=True)
class World:
    """What a spline is executed with."""

    rope: RopeConfig = field(default_factory=RopeConfig)
    """A rope of the simulator's length and links."""
    pace: float = 1.0
    """Factor on the gripper's speed."""
    grasp: tuple[float, float] = (0.0, 0.0)
    """Error in x and y where the fingers close, metres."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Error in x and y of the middle and the end of the motion, metres."""
    reach: float = GRASP_REACH
    """Largest distance from the fingers to a centre line that they catch, metres."""

    def disturb(self, points: Floats, controls: Floats) -> tuple[int | None, Floats]:
        """The link of a rope (V, 3) that is caught, the nearest within `reach` or none, and
        the control points (3, 3) of its motion, in which it keeps its distance from the fingers."""
        link, distance = nearest_link(points, controls[0] + [*self.grasp, 0.0])
        moved = controls.copy()
        moved[:, :2] += (points[link] + points[link + 1])[:2] / 2 - controls[0, :2]
        moved[1:, :2] += self.shift
        return (link if distance <= self.reach else None), moved


@dataclass
class WorldsConfig:
    """What worlds are drawn from."""

    level: int = 1
    """Of the rope, see `perturb_rope`."""
    slowest: float = 0.5
    """Least factor on the pace; it is log-uniform up to `fastest`."""
    fastest: float = 2.0
    """Largest factor on the pace."""
    error: float = 0.0
    """Standard deviation of the gripper's errors in x and y, metres; see `GRIPPER_ERROR_STD`."""

    def __post_init__(self) -> None:
        _check_level(self.level)
        if not 0.0 < self.slowest <= self.fastest < np.inf:
            raise ValueError(
                f"paces of worlds are above 0, the slowest first, got {self.slowest} and "
                f"{self.fastest}"
            )
        if not 0.0 <= self.error < np.inf:
            raise ValueError(f"error of worlds must be 0 or more, got {self.error}")


def draw_worlds(
    rope: RopeConfig,
    count: int,
    rng: np.random.Generator,
    config: WorldsConfig | None = None,
    reach: float = GRASP_REACH,
) -> list[World]:
    """Worlds around a nominal rope, in which fingers catch a strand within a `reach`, metres."""
    config = config or WorldsConfig()
    pace = np.exp(rng.uniform(np.log(config.slowest), np.log(config.fastest), count))
    grasp = rng.normal(0.0, config.error, (count, 2))
    shift = rng.normal(0.0, np.sqrt(2) * config.error, (count, 2))  # of the end against the grasp
    return [
        World(perturb_rope(rope, config.level, rng), *one, reach)
        for one in zip(pace.tolist(), map(tuple, grasp), map(tuple, shift), strict=True)
    ]

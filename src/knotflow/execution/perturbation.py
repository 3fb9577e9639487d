"""How far the stand-in for reality may lie from the planner's model, by level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from knotflow.simulation import RopeConfig

LEVELS = (0, 1, 2)
"""0 is the planner's rope, 1 a rope like it, 2 one that is quite different."""

EXPONENTS = {
    "table_friction": 0.4,
    "rope_friction": 0.4,
    "joint_damping": 0.4,
    "joint_stiffness": 0.7,
    "density": 0.3,
    "radius": 0.1,
}
"""Fields of `RopeConfig` -> a: at level 1 the value is multiplied by e^u, u uniform in [-a, a], at
level 2 in [-2a, 2a]."""


@dataclass(frozen=True)
class Errors:
    """What a robot and its camera do wrong."""

    actuation: float
    """Standard deviation of the gripper's place in x and y while it moves, metres."""
    grasp: float
    """The same of the place at which the fingers close, metres."""
    camera_shift: float
    """Largest error of the camera's position along each axis, metres."""
    camera_turn: float
    """Largest error of its orientation about each axis, radians."""
    camera_noise: float
    """`NoiseConfig.level` of its images."""


ERRORS = (
    Errors(0.0, 0.0, 0.0, 0.0, 0.0),
    Errors(0.006, 0.006, 0.002, np.deg2rad(0.2), 1.0),
    Errors(0.010, 0.010, 0.002, np.deg2rad(0.2), 1.0),
)
"""Of each level."""


def perturb_rope(rope: RopeConfig, level: int, rng: np.random.Generator) -> RopeConfig:
    """A rope whose `EXPONENTS` fields are drawn log-uniformly around those of `rope`."""
    check_level(level)
    factors = {name: np.exp(level * a * rng.uniform(-1, 1)) for name, a in EXPONENTS.items()}
    return replace(rope, **{name: getattr(rope, name) * f for name, f in factors.items()})


def check_level(level: int) -> None:
    """Raise a ValueError for a level that is none."""
    if level not in LEVELS:
        raise ValueError(f"a level is {', '.join(map(str, LEVELS[:-1]))} or {LEVELS[-1]}: {level}")

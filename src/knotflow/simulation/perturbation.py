"""How far the real rope may lie from the planner's model, by level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotflow.simulation.rope import RopeConfig

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

ACTUATION = (0.0, 0.006, 0.010)
"""Standard deviation of the gripper's place in x and y at each level, metres."""

REACH = 0.025
"""Farthest from the fingers that a rope's centre line may lie to be caught as they close, metres:
half their opening."""


def perturb_rope(rope: RopeConfig, level: int, rng: np.random.Generator) -> RopeConfig:
    """A rope whose `EXPONENTS` fields are drawn log-uniformly around those of `rope`.

    Raises:
        ValueError: for a level that is none.
    """
    check_level(level)
    factors = {name: np.exp(level * a * rng.uniform(-1, 1)) for name, a in EXPONENTS.items()}
    return replace(rope, **{name: getattr(rope, name) * f for name, f in factors.items()})


def check_level(level: int) -> None:
    """Raise a ValueError for a level that is none."""
    if level not in LEVELS:
        raise ValueError(f"a level is {', '.join(map(str, LEVELS[:-1]))} or {LEVELS[-1]}: {level}")

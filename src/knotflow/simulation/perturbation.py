"""Perturbed ropes: how far the real rope may differ from the planner's model, by level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotflow.simulation.rope import RopeConfig

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
    if level not in LEVELS:
        raise ValueError(f"unknown level {level!r}; valid levels: {', '.join(map(str, LEVELS))}")
    factors = {name: np.exp(level * a * rng.uniform(-1, 1)) for name, a in EXPONENTS.items()}
    return replace(rope, **{name: getattr(rope, name) * f for name, f in factors.items()})

"""Ropes of other proportions than the nominal one, in units of their length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotflow.simulation.rope import RopeConfig

NOMINAL = RopeConfig()
LINKS = 0.4
"""Links for each diameter in a rope's length,"""
LINKS_STEP, FEWEST_LINKS, MOST_LINKS = 8, 16, 48
"""but a multiple of this, so that few models serve all ropes, and at least and at most so many."""


@dataclass
class ProportionsConfig:
    """What proportions are drawn from, log-uniformly, in lengths of the rope."""

    thinnest: float = 1 / 250
    """Least diameter."""
    thickest: float = 1 / 25
    """Largest diameter."""
    softest: float = 0.01
    """Least bending length, (EI / w)^(1/3) of stiffness EI and weight w a metre."""
    stiffest: float = 0.12
    """Largest bending length."""


def usual_links(diameter: float) -> int:
    """Links of a rope of 1 m by a diameter, metres."""
    links = LINKS_STEP * int(LINKS / diameter / LINKS_STEP + 0.5)
    return min(max(links, FEWEST_LINKS), MOST_LINKS)


def rope_of(diameter: float, bending_length: float, links: int | None = None) -> RopeConfig:
    """A rope of 1 m by a diameter, with a bending length, metres, and the nominal rope's mass and
    damping a metre."""
    radius = 0.5 * diameter
    links = links or usual_links(diameter)
    finer = links / NOMINAL.links
    return RopeConfig(
        radius=radius,
        links=links,
        density=NOMINAL.density * (NOMINAL.radius / radius) ** 2,
        joint_damping=NOMINAL.joint_damping * finer,
        joint_armature=NOMINAL.joint_armature * finer,
        joint_stiffness=NOMINAL.joint_stiffness
        * finer
        * (bending_length / NOMINAL.bending_length) ** 3,
    )


def draw_ropes(
    count: int, rng: np.random.Generator, config: ProportionsConfig | None = None
) -> list[RopeConfig]:
    """Ropes of 1 m of random proportions."""
    config = config or ProportionsConfig()
    low = np.log([config.thinnest, config.softest])
    high = np.log([config.thickest, config.stiffest])
    return [rope_of(*one) for one in np.exp(rng.uniform(low, high, (count, 2))).tolist()]

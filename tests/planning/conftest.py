"""A world without physics: splines that do what their action says, as often as one wants."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from knotflow.planning import Goal, KnotPlan, PlannerConfig, parse_goal, plan_knot
from knotflow.simulation import (
    SPLINE_HIGH,
    SPLINE_LOW,
    Rollouts,
    RopeConfig,
    SimulationConfig,
    control_points,
    resample,
    spline_path,
    straight,
)
from knotflow.topology import Arrange, TopologicalState
from knotflow.topology.draw import draw

# Fine links, so that every drawing of a state reads back as it.
CONFIG = SimulationConfig(rope=RopeConfig(links=120, radius=0.004))
PATH = "R1(0,1,1) C(0,1,1) C(2,0,1)"


@cache
def shape(state: TopologicalState) -> np.ndarray:
    """A rope (V, 3) at rest in a state."""
    if state.num_crossings == 0:
        return straight(CONFIG.rope)
    points = resample(draw(state, gap=2 * CONFIG.rope.radius), CONFIG.rope)
    points[:, 2] += CONFIG.rope.radius
    assert TopologicalState.from_curve(points) == state
    return points


RELEASE = 1.8
"""Seconds from grasp to release."""


class World:
    """Sampler and simulator in one: a spline succeeds with a given chance, else nothing moves."""

    config = CONFIG

    def __init__(self, chance: float = 1.0, diverges: bool = False) -> None:
        self.chance, self.diverges = chance, diverges
        self.ends: dict[bytes, np.ndarray] = {}
        self.batches: list[int] = []
        self.requests: list[tuple[str, str, int]] = []

    def sample(self, points, action, count, rng):
        return self._splines(points, action, count, rng)

    def arrange(self, points, action, count, rng):
        return self._splines(points, Arrange(action), count, rng)

    def _splines(self, points, action, count, rng):
        state = TopologicalState.from_curve(points)
        self.requests.append((str(state), str(action), count))
        splines = rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))
        for spline in splines:
            succeeds = rng.random() < self.chance
            end = shape(state.apply(action)) if succeeds else points
            self.ends[spline.tobytes()] = end
        return splines

    def execute(self, points, splines):
        self.batches.append(len(points))
        times = np.linspace(0.0, 2.5, 26)
        done = np.minimum(times / RELEASE, 1.0)
        ends = np.stack(
            [
                self.ends.get(spline.tobytes(), start)  # a guess moves nothing
                for start, spline in zip(points, splines, strict=True)
            ]
        )
        share = done[:, None, None]
        moved = points[:, None] + share * (ends - points)[:, None]
        controls = control_points(points, splines, self.config.rope.radius)
        ease = done**2 * (3 - 2 * done)
        return Rollouts(
            times=times,
            trajectory=moved.astype(np.float32),
            gripper=spline_path(controls, ease).astype(np.float32),
            frames=np.full(len(points), len(times)),
            release_times=np.full(len(points), RELEASE),
            end_points=ends,
            diverged=np.full(len(points), self.diverges),
        )


@pytest.fixture
def world() -> type[World]:
    return World


@pytest.fixture
def shape_of() -> Callable[[TopologicalState], np.ndarray]:
    return shape


@pytest.fixture(scope="session")
def path_goal() -> Goal:
    return parse_goal(PATH)


@pytest.fixture(scope="session")
def plan(path_goal: Goal) -> KnotPlan:
    """An overhand in three steps."""
    world = World(chance=0.5)
    config = PlannerConfig(batch=4)
    points = straight(CONFIG.rope)
    return plan_knot(points, path_goal, world, world, np.random.default_rng(0), config)

"""A plan for the overhand in which every spline does what its action says."""

import numpy as np
import pytest

from knotflow.planning import PlannerConfig, parse_goal, plan_knot
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
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw


class ObedientWorld:
    """Sampler and simulator in one."""

    config = SimulationConfig(rope=RopeConfig(links=120, radius=0.004))

    def __init__(self):
        self.ends = {}

    def sample(self, points, action, count, rng):
        state = TopologicalState.from_curve(points).apply(action)
        radius = self.config.rope.radius
        end = resample(draw(state, gap=2 * radius), self.config.rope) + [0, 0, radius]
        splines = rng.uniform(SPLINE_LOW, SPLINE_HIGH, (count, 6))
        self.ends |= {spline.tobytes(): end for spline in splines}
        return splines

    def execute(self, points, splines):
        times = np.linspace(0.0, 2.5, 26)
        done = np.minimum(times / 1.8, 1.0)
        ends = np.stack([self.ends.get(spline.tobytes(), rope)
                         for rope, spline in zip(points, splines, strict=True)])  # fmt: skip
        moved = points[:, None] + done[:, None, None] * (ends - points)[:, None]
        controls = control_points(points, splines, self.config.rope.radius)
        gripper = spline_path(controls, done).astype(np.float32)
        return Rollouts(
            times=times,
            trajectory=moved.astype(np.float32),
            gripper=gripper,
            frames=np.full(len(ends), len(times)),
            release_times=np.full(len(ends), 1.8),
            end_points=ends,
            diverged=np.zeros(len(ends), bool),
        )


@pytest.fixture(scope="session")
def plan():
    """An overhand in three steps."""
    world = ObedientWorld()
    goal, rng = parse_goal("R1(0,1,1) C(0,1,1) C(2,0,1)"), np.random.default_rng(0)
    start = straight(world.config.rope)
    return plan_knot(start, goal, world, world, rng, PlannerConfig(batch=4))

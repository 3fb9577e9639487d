"""The aimed guess keeps to the strategy of Sec. V-A."""

import numpy as np
import pytest

from knotflow.demonstrations import TASKS, aim, succeed, task
from knotflow.simulation import check_splines, random_curve, reached, straight
from knotflow.topology import segment_intervals


@pytest.mark.slow
@pytest.mark.parametrize("name", ["R1(0,1,1)", "R2(0,0,1,1)"])
def test_it_reaches_untangled_actions_now_and_then(simulator, rng, name):
    points = straight(simulator.config.rope)
    assert succeed(points, aim(points, task(name).action, 64, rng), task(name), simulator).any()


def test_it_grasps_the_segment_that_will_be_over(simulator, rng):
    one = task("C(0,2,1)")
    points = reached(one.start_actions, 1, simulator, aim, rng).points[0]
    segments = segment_intervals(points)
    for other in TASKS:
        if other.start_state != one.start_state:
            continue
        splines = check_splines(aim(points, other.action, 50, rng))
        low, high = segments[other.action.over_segment]
        assert ((splines[:, 0] >= low) & (splines[:, 0] <= high)).all()


def test_it_is_the_same_for_the_same_seed_and_in_range():
    rope = random_curve_of_default_rope()
    one, other = (aim(rope, TASKS[0].action, 20, np.random.default_rng(1)) for _ in range(2))
    assert np.array_equal(one, other)
    check_splines(one)


def random_curve_of_default_rope():
    from knotflow.simulation import RopeConfig

    return random_curve(RopeConfig(), np.random.default_rng(0))

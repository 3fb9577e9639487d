"""What is measured of a plan, on plans whose numbers are known."""

import numpy as np
import pytest

from knotflow.samplers.causal_infogan import measure
from knotflow.simulation import RopeConfig, straight

ROPE = straight(RopeConfig())


def shifted(*steps):
    """(len(steps), V, 3): the straight rope moved along y."""
    return np.stack([ROPE + [0, step, 0] for step in steps])


def test_even_progress_has_no_unevenness():
    plan = measure(ROPE, *(shifted(0)[0], shifted(0.1, 0.2), shifted(0.3)[0]), shifted(0.5)[0])
    assert plan.unevenness == pytest.approx(0, abs=1e-9)
    assert plan.start_distance == pytest.approx(0)
    assert plan.end_distance == pytest.approx(0.2)
    assert plan.start_kept and plan.end_kept
    assert plan.largest_stretch == pytest.approx(0, abs=1e-9)


def test_a_jump_makes_progress_uneven():
    plan = measure(ROPE, *(shifted(0)[0], shifted(0, 0.3), shifted(0.3)[0]), shifted(0.3)[0])
    assert plan.unevenness == pytest.approx(np.sqrt(2))


def test_a_longer_link_and_a_crossing_are_told():
    stretched = shifted(0.1)
    stretched[0, 20:] += [0.0125, 0, 0]
    along = np.linspace(0, 1.5 * 2 * np.pi, 41)
    loop = np.stack([np.cos(along), np.sin(along), 0.02 * along], axis=1)
    loop[:, 0] += 0.05 * along
    plan = measure(ROPE, shifted(0)[0], stretched, loop, shifted(0.1)[0])
    assert plan.largest_stretch > 0.5 - 1e-9
    assert plan.start_kept and not plan.end_kept


def test_a_plan_that_stands_still_is_even():
    plan = measure(ROPE, ROPE, shifted(0, 0), ROPE, ROPE)
    assert plan.unevenness == 0

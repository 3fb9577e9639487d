"""What a batch of attempts leaves in a file."""

import numpy as np
import pytest

from knotflow.simulation import Attempts, Rollouts, RopeConfig, Trials, arc, straight
from knotflow.topology import TopologicalState, parse_action


@pytest.mark.parametrize("kind", [Attempts, Trials])
def test_trials_are_read_as_they_were_saved(kind, tmp_path):
    rope, action = RopeConfig(), parse_action("R1(0,1,1)")
    points = np.stack([straight(rope), arc(rope)])
    splines = np.arange(12.0).reshape(2, 6)
    goal = TopologicalState.trivial().apply(action)
    rollouts = Rollouts.between(points, points)
    tried = Attempts.of(action, TopologicalState.trivial(), points, splines, rollouts, [None, goal])
    tried.save(tmp_path / "tried.npz")
    found = kind.load(tmp_path / "tried.npz")
    assert (found.action, found.start, found.goal) == (action, tried.start, goal)
    assert found.success.tolist() == [False, True]
    np.testing.assert_array_equal(found.points, points)
    np.testing.assert_array_equal(found.splines, splines)

"""Playbacks of plans and single splines."""

import numpy as np
import pytest

from knotflow.apps.studio.playback import Playback
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.simulation import Attempts, Rollouts, straight
from knotflow.simulation.rope import RopeConfig

ROPE = RopeConfig()


@pytest.fixture
def attempts():
    """Two splines that did nothing, in two frames each."""
    one = load_demonstrations()[0]
    points = np.broadcast_to(straight(ROPE), (2, 41, 3))
    rollouts = Rollouts.between(points, points, np.array([False, True]))
    splines = np.stack([one.spline, one.spline])
    return Attempts.of(one.task.action, one.task.start_state, points, splines, rollouts)


@pytest.mark.parametrize(("row", "words"), [(0, "ends in trivial"), (1, "ends in unreadable")])
def test_playback_of_attempt_names_outcome(attempts, row, words):
    shown = Playback.of_attempt(attempts, row, ROPE.radius)
    assert len(shown) == len(shown.ropes) == len(shown.grippers) == 2
    assert shown.controls.shape == (1, 3, 3)
    assert shown.caption(1) == f"1.0 s: R1(0,1,1), {words}"
    assert np.isclose(shown.controls[0, 2], [*attempts.splines[row, 4:], ROPE.radius]).all()

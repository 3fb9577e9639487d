"""Frames of single splines."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.apps.studio.playback import attempt_frames
from knotflow.samplers.demonstrations import load_demonstrations
from knotflow.simulation import Attempts, Rollouts, straight
from knotflow.simulation.rope import RopeConfig

ROPE = RopeConfig()


@pytest.fixture
def attempts():
    """Two splines that did nothing, in two frames each."""
    one = load_demonstrations()[0]
    points = np.broadcast_to(straight(ROPE), (2, 41, 3))
    rollouts = replace(Rollouts.between(points, points), diverged=np.array([False, True]))
    splines = np.stack([one.spline, one.spline])
    return Attempts.of(one.task.action, one.task.start_state, points, splines, rollouts)


@pytest.mark.parametrize(("row", "words"), [(0, "ends in trivial"), (1, "ends in unreadable")])
def test_frames_of_attempt_name_outcome(attempts, row, words):
    shown = attempt_frames(attempts, row, ROPE.radius)
    assert len(shown) == 2
    assert shown[0].controls.shape == (3, 3)
    assert shown[1].caption == f"1.0 s: R1(0,1,1), {words}"
    assert np.isclose(shown[0].controls[2], [*attempts.splines[row, 4:], ROPE.radius]).all()

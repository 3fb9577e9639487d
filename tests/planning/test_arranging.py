"""An attempt of several splines, in a world where an arranging spline does what it shall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import attempt_arranged
from knotflow.simulation import Rollouts, SimulationConfig, straight
from knotflow.topology import Arrange, IllegalActionError, TopologicalState, parse_action

ACTION = parse_action("R1(0,1,1)")
TRIVIAL = TopologicalState.trivial()
ROPE = straight(SimulationConfig().rope)
ARRANGING = 0.5
"""Grasp of the splines that arrange."""


class Lifted:
    """A rope's height is how well it is arranged: `arrange` lifts it, up to the third time."""

    config = SimulationConfig()

    def __init__(self, loses=False):
        self.asked, self.loses = [], loses

    def sample(self, points, action, count, rng):
        self.asked.append("act")
        return np.zeros((count, 6))

    def values(self, points, actions, rng):
        return 10 * np.array([rope[0, 2] for rope in points])

    def arranged_values(self, points, actions, rng):
        return np.minimum(self.values(points, actions, rng) + 0.1, 0.38)

    def arrange(self, points, action, count, rng):
        self.asked.append("arrange")
        return np.full((count, 6), ARRANGING)

    def execute(self, points, splines):
        arranging = splines[:, 0] == ARRANGING
        after = points + np.where(arranging, 0.01, 0.0)[:, None, None] * [0, 0, 1]
        if self.loses:
            after[arranging] = points[arranging] + [0, 0, np.nan]
        diverged = np.isnan(after).any(axis=(1, 2))
        return replace(Rollouts.between(points, np.nan_to_num(after)), diverged=diverged)


def attempts(sampler, most, observe=None):
    points = np.stack([ROPE, ROPE + [0, 0, 0.02]])
    rng = np.random.default_rng(0)
    return attempt_arranged(points, ACTION, TRIVIAL, sampler, sampler, rng, most, observe)


def test_ropes_are_arranged_while_the_critic_promises_more_and_then_acted_on():
    seen = []
    # From 0.008 m on, the gains are 0.1, 0.1, 0.1 and then too small; from 0.028 m there is one.
    success, used = attempts(Lifted(), 9, seen.append)
    assert used.tolist() == [4, 2]
    assert [str(one.action) for one in seen] == [str(Arrange(ACTION))] * 3 + [str(ACTION)]
    assert [len(one) for one in seen] == [2, 1, 1, 2]
    assert not success.any()  # nothing ever gets crossings here


@pytest.mark.parametrize("most", [0, 1])
def test_there_are_at_most_so_many_arranging_splines(most):
    assert attempts(Lifted(), most)[1].tolist() == [most + 1] * 2


def test_an_attempt_that_loses_the_state_ends():
    sampler = Lifted(loses=True)
    assert attempts(sampler, 3)[1].tolist() == [1, 1]
    assert "act" not in sampler.asked


def test_a_sampler_that_cannot_arrange_acts_at_once():
    sampler = Lifted()
    sampler.capabilities = {"values"}
    assert attempts(sampler, 3)[1].tolist() == [1, 1]
    assert sampler.asked == ["act", "act"]


def test_an_illegal_action_is_refused():
    sampler, illegal = Lifted(), parse_action("C(0,1,1)")
    with pytest.raises(IllegalActionError):
        attempt_arranged(ROPE[None], illegal, TRIVIAL, sampler, sampler, np.random.default_rng(0))

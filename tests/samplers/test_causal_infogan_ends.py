"""Goals of Causal InfoGAN, and how an end shape is sought for them."""

from types import SimpleNamespace

import numpy as np

from knotflow.samplers.causal_infogan.ends import GOALS, OVERHAND, _reach
from knotflow.samplers.demonstrations import task
from knotflow.simulation import SimulationConfig, straight
from knotflow.topology import TopologicalState


def test_goals_are_the_eight_actions_and_the_overhand():
    assert len(GOALS) == 9
    overhand = next(goal for goal in GOALS if goal.name == OVERHAND)
    assert [str(action) for action in overhand.actions] == ["R1(0,1,1)", "C(0,1,1)", "C(2,0,1)"]
    assert len({goal.file for goal in GOALS}) == 9
    assert overhand.start_state == TopologicalState.trivial()


def test_a_chain_tries_another_way_when_the_next_action_fails():
    chain = (task("C(0,1,1)").start_actions[0], task("C(0,1,1)").action)
    first, second = map(str, chain)
    trivial, rope = TopologicalState.trivial(), straight(SimulationConfig().rope)
    asked = []

    def propose(points, action, state):
        """The first action always succeeds, the second one at the fifth batch."""
        asked.append(str(action))
        success = np.array([str(action) == first or len(asked) == 5])
        return SimpleNamespace(success=success, rollouts=SimpleNamespace(end_points=rope[None]))

    end = _reach(rope, trivial, chain, propose, iter(range(6)), 2)
    assert end is not None
    assert asked == [first, second, second, first, second]
    asked.clear()
    assert _reach(rope, trivial, chain, propose, iter(range(4)), 2) is None
    assert len(asked) == 4

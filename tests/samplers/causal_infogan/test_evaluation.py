"""Goals of Causal InfoGAN, the search for reachable ends, and measures of known plans."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from knotflow.samplers.causal_infogan.evaluation import (
    GOALS,
    OVERHAND,
    ActionSequence,
    compare,
    measure,
    reachable_end,
)
from knotflow.samplers.demonstrations import TASKS, task
from knotflow.simulation import RopeConfig, straight
from knotflow.topology import TopologicalState

ROPE = straight(RopeConfig())


def test_goals_are_the_eight_actions_and_the_overhand():
    assert len(GOALS) == 9
    overhand = next(goal for goal in GOALS if goal.name == OVERHAND)
    assert [str(action) for action in overhand.actions] == ["R1(0,1,1)", "C(0,1,1)", "C(2,0,1)"]
    assert len({goal.file for goal in GOALS}) == 9
    assert overhand.first.start_state == TopologicalState.trivial()


@pytest.mark.parametrize(("rounds", "batches"), [(2, "1221"), (3, "122212")])
def test_search_for_an_end_repeats_the_action_before_one_that_fails(rounds, batches):
    """The first action always succeeds, the second one in the sixth batch."""
    second = task("C(0,1,1)")
    both = ActionSequence("both", TASKS[0], (second.start_actions[0], second.action))
    asked = []

    def propose(points, action, state):
        asked.append(str(1 + both.actions.index(action)))
        success = np.array([action == both.actions[0] or len(asked) == 6])
        return SimpleNamespace(success=success, rollouts=SimpleNamespace(end_points=ROPE[None]))

    end = reachable_end(ROPE, both, propose, rounds)
    assert "".join(asked) == batches
    assert (end is not None) == (len(batches) == 6)


def shifted(*steps):
    """(len(steps), V, 3): the straight rope moved along y."""
    return np.stack([ROPE + [0, step, 0] for step in steps])


def test_even_progress_has_no_unevenness():
    plan = measure(ROPE, *(shifted(0)[0], shifted(0.1, 0.2), shifted(0.3)[0]), shifted(0.5)[0])
    assert plan.unevenness == pytest.approx(0, abs=1e-9)
    assert plan.start_distance == pytest.approx(0)
    assert plan.end_distance == pytest.approx(0.2)
    assert plan.start_state == plan.end_state == "kept"


def test_a_jump_makes_progress_uneven():
    plan = measure(ROPE, *(shifted(0)[0], shifted(0, 0.3), shifted(0.3)[0]), shifted(0.3)[0])
    assert plan.unevenness == pytest.approx(np.sqrt(2))


def test_a_crossing_is_another_topology():
    along = np.linspace(0, 1.5 * 2 * np.pi, 41)
    loop = np.stack([np.cos(along), np.sin(along), 0.02 * along], axis=1)
    loop[:, 0] += 0.05 * along
    plan = measure(ROPE, shifted(0)[0], shifted(0.1), loop, shifted(0.1)[0])
    assert (plan.start_state, plan.end_state) == ("kept", "another")


def test_a_plan_that_stands_still_is_even():
    plan = measure(ROPE, ROPE, shifted(0, 0), ROPE, ROPE)
    assert plan.unevenness == 0


def test_a_shape_that_cannot_be_read_is_not_of_another_topology():
    folded = ROPE.copy()
    folded[20:] = ROPE[20::-1][: len(ROPE) - 20]
    plan = measure(ROPE, folded, shifted(0, 0.1), folded, ROPE)
    assert plan.start_state == plan.end_state == "unreadable"


def test_methods_are_compared_on_the_starts_that_have_an_end():
    row = {"model": "single", "seed": 1, "goal": "C(0,1,1)", "shapes": "unseen", "start": 3}
    states = [("kept", "kept"), ("kept", "unreadable")]
    plans = [row | {"start_state": one, "end_state": other} for one, other in states]
    plans.append(plans[0] | {"shapes": "training", "start": 4})
    actions = ("C(0,1,1)", "C(0,2,1)")
    tried = [("icp", "", action, start, 1) for action in actions for start in (3, 4)]
    columns = ["method", "training_seed", "action", "start", "success"]
    found = compare(pd.DataFrame(plans), pd.DataFrame(tried, columns=columns))
    assert found.to_numpy().tolist() == [
        ["causal_infogan_single", "C(0,1,1)", 1, 3, 2, 1],
        ["icp", "C(0,1,1)", "", 3, 1, 1],
    ]

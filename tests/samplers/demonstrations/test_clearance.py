"""What an end leaves room for."""

import numpy as np
import pytest

from knotflow.samplers.demonstrations import TASKS, Demonstrator, task
from knotflow.samplers.demonstrations.scripted import (
    Candidate,
    DemonstratorConfig,
    larger_loops,
    loop_size,
    next_actions,
)
from knotflow.simulation import RopeConfig, resample
from knotflow.topology import TopologicalState, parse_action

ROPE = RopeConfig()
R1 = task("R1(0,1,1)")


def loop(circumference):
    """A rope (V, 3) after R1(0,1,1), its loop about `circumference` metres long."""
    along = np.linspace(0, 1, 400)
    first, last = 0.5 - circumference / 2, 0.5 + circumference / 2
    turned = np.clip((along - first) / circumference, 0, 1)
    heading = 0.3 + (2 * np.pi - 0.3) * turned
    curve = np.cumsum(np.stack([np.cos(heading), np.sin(heading), 0 * heading], 1), 0) / 400
    curve[:, 2] = 0.008 + 0.016 * np.exp(-(((along - last) / 0.04) ** 2))
    return resample(curve, ROPE)


WIDE, TIGHT = loop(0.4), loop(0.16)


def candidate(end, share):
    return Candidate(np.full(6, 0.1), end, end[None], share, loop_size(end, ROPE))


def test_the_constructed_pair_differs_in_its_loop_alone():
    assert all(TopologicalState.from_curve(end) == R1.goal_state for end in (WIDE, TIGHT))
    assert loop_size(TIGHT, ROPE) < 0.6 * loop_size(WIDE, ROPE)


def test_what_may_follow_is_legal_and_on_the_way_to_a_knot(rng):
    assert {str(action) for action in next_actions(R1, rng)} == {
        "C(0,1,1)", "C(0,2,1)", "C(2,1,-1)", "C(2,0,-1)",
    }  # fmt: skip
    for one in TASKS:
        actions = next_actions(one, rng)
        assert actions
        for action in actions:
            assert one.goal_state.apply(action).num_crossings == one.goal_state.num_crossings + 1


@pytest.mark.slow
def test_a_wider_loop_leaves_more_room(simulator):
    action, config = (parse_action("C(0,1,1)"),), DemonstratorConfig(room_guesses=16)
    wide, tight = (
        Demonstrator(R1, simulator, np.random.default_rng(0), config).clearance(end[None], action)
        for end in (WIDE, TIGHT)
    )
    assert 0 < tight < wide < 1


@pytest.mark.parametrize(("share_of_tight", "best"), [(0.8, WIDE), (0.9, WIDE), (1.0, TIGHT)])
def test_the_score_weighs_share_and_room(simulator, rng, monkeypatch, share_of_tight, best):
    """The wide loop leaves 1.5 times the room, so it may succeed that much less often."""
    rooms = {id(WIDE): 0.3, id(TIGHT): 0.2}
    monkeypatch.setattr(Demonstrator, "clearance", lambda _, ends, actions: rooms[id(ends.base)])
    finalists = [candidate(TIGHT, share_of_tight), candidate(WIDE, 0.62)]
    found = Demonstrator(R1, simulator, rng).best(finalists)
    assert found is not None
    assert found.end is best
    assert found.score == found.success_rate * found.clearance


def test_the_filter_keeps_the_ends_withlarger_loops():
    splines = np.arange(12)[:, None] * np.ones(6)
    ends = np.stack([WIDE if i % 2 else TIGHT for i in range(12)])
    assert sorted(larger_loops(splines, ends, ROPE)[:, 0]) == [1, 3, 5, 7, 9, 11]


def test_without_a_finalist_there_is_nothing_to_show(simulator, rng):
    assert Demonstrator(R1, simulator, rng).best([]) is None

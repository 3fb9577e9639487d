from __future__ import annotations

import numpy as np
import pytest

from knotflow.topology import R1, Cross, TopologicalState, Undo, parse_action
from knotflow.training import SelfPlayConfig
from knotflow.training.curriculum import (
    KIND_SHARES,
    Curriculum,
    PairStats,
    pairs_by_kind,
    sampling_priority,
)

TRIVIAL = TopologicalState.trivial()
LOOP = TRIVIAL.apply(parse_action("R1(0,1,1)"))


def curriculum_of(most_crossings, crossings_shares, undo_share):
    shares = {"crossings_shares": crossings_shares, "undo_share": undo_share}
    return Curriculum(SelfPlayConfig(most_crossings=most_crossings, **shares))


def test_the_outcomes_of_a_state_are_its_actions_and_their_inverses():
    for most in (2, 3):
        actions = [action for pairs in pairs_by_kind(LOOP, most).values() for _, action in pairs]
        assert Undo(parse_action("R1(0,1,1)")) in actions
        assert max(LOOP.apply(action).num_crossings for action in actions) == most


def test_priority_is_least_where_everything_or_nothing_succeeds():
    never, sometimes, often, solved = PairStats(), PairStats(), PairStats(), PairStats()
    for trial in range(200):
        often.add(False)
        sometimes.add(trial % 4 == 0)
        solved.add(True)
    assert min(never.priority, sometimes.priority) > often.priority > solved.priority > 0
    assert 0 == sampling_priority(np.array(0.0)) == sampling_priority(np.array(1.0))
    assert (often.trials, often.successes, often.rate) == (200, 0, 0.0)
    assert solved.rate == 1.0
    for _ in range(300):
        solved.add(False)
    assert solved.rate < 0.1  # what counts is what happens now


def test_rarely_solved_pairs_are_drawn_more_often():
    curriculum, rng = curriculum_of(1, [1.0], 0.0), np.random.default_rng(0)
    solved = parse_action("R1(0,1,1)")
    for _ in range(1000):
        curriculum.add(TRIVIAL, solved, True)
    drawn = [curriculum.draw({0: [TRIVIAL]}, rng)[1] for _ in range(400)]
    assert 0 < drawn.count(solved) < 40 < drawn.count(parse_action("R1(0,-1,1)"))


def test_draws_respect_the_shares_of_crossings_and_of_undoing():
    curriculum, rng = curriculum_of(3, [1.0, 3.0], 0.25), np.random.default_rng(0)
    beyond = LOOP.apply(parse_action("C(0,1,1)"))
    known = curriculum.by_crossings([TRIVIAL, LOOP, beyond])
    assert known == {0: [TRIVIAL], 1: [LOOP]}
    drawn = [curriculum.draw(known, rng) for _ in range(800)]
    looped = [action for state, action in drawn if state == LOOP]
    assert len(looped) / len(drawn) == pytest.approx(0.75, abs=0.05)
    undone = sum(isinstance(action, Undo) for action in looped)
    assert undone / len(looped) == pytest.approx(0.25, abs=0.06)


def test_next_actions_are_legal_and_never_beyond_the_most_crossings():
    curriculum, rng = curriculum_of(1, [1.0, 1.0], 0.5), np.random.default_rng(0)
    following = curriculum.next_action(TRIVIAL, rng)
    assert following is not None
    assert TRIVIAL.apply(following).num_crossings == 1
    assert curriculum.next_action(LOOP, rng) is None


def test_what_was_counted_can_be_saved_and_loaded():
    curriculum = curriculum_of(3, [1.0], 0.0)
    undo = Undo(parse_action("R1(0,1,1)"))
    curriculum.add(LOOP, undo, True)
    other = curriculum_of(3, [1.0], 0.0)
    other.load_state_dict(curriculum.state_dict())
    assert other.stats == {(LOOP, undo): PairStats(1, 1, 1.0)}


def test_kinds_are_drawn_by_their_shares():
    """As R1 on end segments and Cross reach every state of three crossings, R2 may be rare."""
    reached = {TRIVIAL}
    for _ in range(3):
        reached |= {
            after
            for state in reached
            for action, after in state.actions()
            if isinstance(action, Cross)
            or (isinstance(action, R1) and action.index in (0, state.num_segments - 1))
        }
    assert sum(state.num_crossings == 3 for state in reached) == 528
    curriculum, rng = curriculum_of(3, [0.0, 1.0], 0.0), np.random.default_rng(0)
    of = {pair: kind for kind, pairs in pairs_by_kind(LOOP, 3).items() for pair in pairs}
    drawn = [of[curriculum.draw({1: [LOOP]}, rng)] for _ in range(600)]
    shares = {name: share / sum(KIND_SHARES.values()) for name, share in KIND_SHARES.items()}
    assert {name: drawn.count(name) / 600 for name in shares} == pytest.approx(shares, abs=0.06)

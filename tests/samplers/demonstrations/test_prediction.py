"""Effects of splines, predicted without simulation."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.samplers.demonstrations import (
    arranging_splines,
    heuristic_splines,
    screened_arranging_splines,
    screened_splines,
)
from knotflow.samplers.demonstrations.prediction import predict_shapes, predict_states
from knotflow.simulation import (
    RopeConfig,
    RopeSimulator,
    SimulationConfig,
    arc,
    end_states,
    state_or_none,
    straight,
)
from knotflow.topology import TopologicalState, parse_action

ROPE = RopeConfig()
R1_ACTION = parse_action("R1(0,1,1)")


@pytest.fixture
def rope():
    return arc(ROPE, 1.5)


@pytest.fixture
def splines(rope):
    return heuristic_splines(rope, R1_ACTION, 40, np.random.default_rng(0))


def test_links_keep_their_lengths_and_the_grasped_vertex_ends_where_it_is_released(rope, splines):
    shapes = predict_shapes(rope, splines)
    lengths = np.linalg.norm(np.diff(shapes, axis=1), axis=2)
    np.testing.assert_allclose(lengths, ROPE.length / ROPE.links, rtol=1e-6)
    grasped = np.rint(splines[:, 0] * ROPE.links).astype(int)
    released = shapes[np.arange(len(splines)), grasped]
    np.testing.assert_allclose(released[:, :2], splines[:, 4:], atol=1e-9)


def test_splines_are_followed_alone_as_together(rope, splines):
    together = predict_shapes(rope, splines)
    for row in range(0, len(splines), 7):
        np.testing.assert_array_equal(
            predict_shapes(rope, splines[row : row + 1])[0], together[row]
        )
    assert predict_shapes(rope, splines[:0]).shape == (0, *rope.shape)


def test_a_mirrored_rope_follows_in_the_mirror(rope, splines):
    flip = np.array([1, -1, 1])
    mirrored = splines * [1, 1, -1, 1, 1, -1]
    np.testing.assert_allclose(
        predict_shapes(rope * flip, mirrored), predict_shapes(rope, splines) * flip, atol=1e-12
    )
    states = predict_states(rope, splines)
    assert predict_states(rope * flip, mirrored) == [state and state.mirrored() for state in states]


def test_a_head_laid_over_the_rope_is_predicted_to_cross_it():
    rope = straight(ROPE)
    head, middle = rope[0], rope[len(rope) // 2]
    side = np.array([0.0, 0.15])
    over = np.concatenate([[0.0], (head + middle)[:2] / 2 + 2 * side, [0.2], middle[:2] - side])
    (state,) = predict_states(rope, over[None])
    assert state is not None
    ((over_at, under_at, _),) = state.crossings
    assert (over_at, under_at) == (1, 2)


def test_crossings_that_stay_keep_their_order():
    # The tail, which lies below, is moved a little: what moves farther would be on top.
    turn = np.linspace(-2.9, 2.9, 60)
    loop = np.stack([0.03 * turn - 0.08 * np.sin(turn), -0.08 * np.cos(turn), 0 * turn], axis=1)
    loop[turn < -1.5, 2] = 0.016
    before = TopologicalState.from_curve(loop)
    assert before.num_crossings == 1
    tail = np.array([[1.0, *(loop[-1, :2] + [0.005, 0.005]), 0.05, *(loop[-1, :2] + 0.01)]])
    assert predict_states(loop, tail) == [before]


@pytest.mark.slow
def test_what_is_predicted_to_succeed_succeeds_more_often():
    """On hard and easy ropes alike a prediction must say something of what the simulator does."""
    ropes = [straight(ROPE), arc(ROPE, 2.0), arc(ROPE, -2.0)]
    goal = TopologicalState.trivial().apply(R1_ACTION)
    rng = np.random.default_rng(1)
    plain, chosen = (
        [choose(rope, R1_ACTION, 24, rng) for rope in ropes]
        for choose in (heuristic_splines, screened_splines)
    )
    simulator = RopeSimulator(SimulationConfig(threads=2))
    starts = np.repeat(np.stack(ropes), 24, axis=0)
    rates = [
        np.mean(
            [end == goal for end in end_states(simulator.execute(starts, np.concatenate(some)))]
        )
        for some in (plain, chosen)
    ]
    assert rates[1] > 1.2 * rates[0] > 0


def test_among_the_promising_the_worth_decides(rope):
    def worth(splines):
        return -splines[:, 0]

    some = screened_splines(rope, R1_ACTION, 4, np.random.default_rng(2), worth)
    guesses = heuristic_splines(rope, R1_ACTION, 4 * 32, np.random.default_rng(2))
    goal = TopologicalState.trivial().apply(R1_ACTION)
    good = guesses[[state == goal for state in predict_states(rope, guesses)]]
    best = good[np.argsort(good[:, 0])]
    assert len(best) > 4
    np.testing.assert_array_equal(some[0], best[0])
    assert (some[:, None] == guesses[None]).all(2).any(1).all()


@pytest.mark.slow
def test_without_a_promising_guess_there_are_guesses_all_the_same():
    rope = straight(ROPE)
    action = parse_action("R2(0,0,1,1)")
    some = screened_splines(rope, action, 300, np.random.default_rng(3))
    assert some.shape == (300, 6)
    assert len(np.unique(some, axis=0)) == 300


def test_moves_are_chosen_by_what_they_are_predicted_to_leave(rope):
    def worth(shapes):
        return shapes[:, 0, 0]

    moves = screened_arranging_splines(rope, R1_ACTION, 4, np.random.default_rng(4), worth)
    all_moves = arranging_splines(rope, R1_ACTION, 4 * 16, np.random.default_rng(4))
    shapes = predict_shapes(rope, all_moves)
    shapes[..., 2] = rope[:, 2]
    kept = [row for row in range(64) if state_or_none(shapes[row]) == TopologicalState.trivial()]
    best = max(kept, key=lambda row: shapes[row, 0, 0])
    np.testing.assert_array_equal(moves[0], all_moves[best])
    assert moves.shape == (4, 6)

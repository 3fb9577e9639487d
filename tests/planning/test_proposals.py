"""Splines and values for what a sampler does not know."""

import numpy as np
import pytest

from knotflow.planning import PlannerConfig, parse_goal
from knotflow.planning.proposals import (
    UNDO_VALUE,
    Proposals,
    clearance,
    group_by_query,
    prospect,
)
from knotflow.planning.rules import ACT, ARRANGE, Expansion, Node
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW, SplineError
from knotflow.topology import TopologicalState, Undo

LOOP = TopologicalState.parse("2o1+")


class Critic:
    """Values every action alike, and takes down what it is asked."""

    def __init__(self, capabilities):
        self.capabilities, self.asked = capabilities, []

    def sample(self, points, action, count, rng):
        self.asked.append(action)
        return np.tile((SPLINE_LOW + SPLINE_HIGH) / 2, (count, 1))

    def values(self, points, actions, rng):
        self.asked.extend(actions)
        return np.full(len(actions), 0.7)


@pytest.fixture
def node(shape_of):
    graph = parse_goal("overhand").dag.with_undoings()
    return Node(shape_of(LOOP), LOOP, graph.distance(LOOP), graph.edges_from(LOOP))


@pytest.mark.parametrize("capabilities", [{"values"}, {"values", "undo"}])
def test_undoing_is_aimed_for_sampler_without_it(node, capabilities):
    critic, rng = Critic(capabilities), np.random.default_rng(0)
    proposals = Proposals(critic, parse_goal("overhand"), PlannerConfig(), rng)
    undoing = np.array([isinstance(action, Undo) for action, _ in node.edges])
    assert 0 < undoing.sum() < len(undoing)
    proposals.evaluate([node])
    np.testing.assert_array_equal(node.values[~undoing], 0.7)
    undo_value = 0.7 if "undo" in capabilities else UNDO_VALUE
    np.testing.assert_array_equal(node.values[undoing], undo_value)

    edge = int(np.flatnonzero(undoing)[0])
    branches = [Expansion(node, edge, ACT), Expansion(node, edge, ARRANGE)]
    splines = np.concatenate(list(proposals.splines(branches)))
    assert splines.shape == (2, 6)
    assert (splines >= SPLINE_LOW).all() and (splines <= SPLINE_HIGH).all()
    assert any(isinstance(action, Undo) for action in critic.asked) == ("undo" in capabilities)


def test_prospect_is_of_the_best_action_and_the_room_for_it(node, shape_of):
    straight = Node(shape_of(TopologicalState.trivial()), LOOP, 0)
    assert prospect(straight) == 1.0  # a tied rope needs no action
    node.values = np.linspace(0.2, 0.6, len(node.edges))
    assert prospect(node) == pytest.approx(0.6 * clearance(node.points))


def test_sampler_is_asked_once_per_query(node):
    critic = Critic(set())
    proposals = Proposals(critic, parse_goal("overhand"), PlannerConfig(), np.random.default_rng(0))
    edges = [0, 1, 0, 1, 0]
    branches = group_by_query([Expansion(node, edge, ACT) for edge in edges])
    assert [branch.edge for branch in branches] == sorted(edges)
    assert [len(splines) for splines in proposals.splines(branches)] == [3, 2]
    assert critic.asked == [node.edges[0][0], node.edges[1][0]]


@pytest.mark.parametrize(
    ("splines", "told"),
    [
        (np.full((3, 6), np.nan), "= nan"),
        (np.full((3, 5), 0.1), r"got \(3, 5\)"),
        (np.full(6, 0.1), r"asked for 3 splines .* \(6,\), in place of \(3, 6\)"),
        (None, "splines"),
    ],
)
def test_what_a_sampler_gives_wrongly_is_told(node, splines, told):
    class Wrong(Critic):
        def sample(self, *_):
            return splines

    proposals = Proposals(
        Wrong(set()),
        parse_goal("overhand"),
        PlannerConfig(guess_fraction=0.0),
        np.random.default_rng(),
    )
    with pytest.raises(SplineError, match=told):
        list(proposals.splines([Expansion(node, 0, ACT)] * 3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("value", "rule", "share"),
    [(0.1, "posterior", 0.5), (0.7, "posterior", 0.0), (0.1, "paper", 0.0)],
)
def test_guesses_are_mixed_in_at_low_values(node, value, rule, share):
    config = PlannerConfig(rule=rule, guess_fraction=0.5, guess_below_value=0.3)
    rng = np.random.default_rng(0)
    proposals = Proposals(Critic(set()), parse_goal("overhand"), config, rng)
    node.values = np.full(len(node.edges), value)
    (splines,) = proposals.splines([Expansion(node, 0)] * 200)
    guessed = (splines != (SPLINE_LOW + SPLINE_HIGH) / 2).any(axis=1)
    assert guessed.mean() == pytest.approx(share, abs=0.12)


@pytest.mark.slow
def test_guesses_are_mixed_in_after_a_success(node):
    proposals = Proposals(
        Critic(set()), parse_goal("overhand"), PlannerConfig(), np.random.default_rng(0)
    )
    node.values = np.full(len(node.edges), 0.9)
    node.successes[ACT, 0] = 1
    for edge, share in ((0, 0.5), (1, 0.0)):
        (splines,) = proposals.splines([Expansion(node, edge)] * 200)
        guessed = (splines != (SPLINE_LOW + SPLINE_HIGH) / 2).any(axis=1)
        assert guessed.mean() == pytest.approx(share, abs=0.12)


def test_splines_for_several_ropes_are_those_that_most_of_them_judge_well(node, rng):
    class Judge(Critic):
        """One rope judges splines by their height, the other one by their grasp."""

        def success_probability(self, points, action, splines):
            self.judged.append(points)
            return splines[:, 3 * (len(self.judged) % 2)]

    judge = Judge({"success_probability"})
    judge.judged = []
    proposals = Proposals(judge, parse_goal("overhand"), PlannerConfig(), rng)
    ropes = np.stack([node.points, node.points + 0.001])
    near = (SPLINE_LOW + SPLINE_HIGH) / 2
    found = proposals.for_worlds(Expansion(node, 0), ropes, near, 4)
    assert found.shape == (4, 6)
    assert len(judge.judged) == 2
    assert (judge.judged[0] != judge.judged[1]).any()
    judged = found[:, 0] + found[:, 3]
    assert (np.diff(judged) <= 0).all() and judged[0] > near[0] + near[3]  # a noisy copy
    without = Proposals(Critic(set()), parse_goal("overhand"), PlannerConfig(), rng)
    assert without.for_worlds(Expansion(node, 0), ropes, near, 4).shape == (4, 6)

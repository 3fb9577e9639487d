"""Splines and values for what a sampler does not know."""

import numpy as np
import pytest

from knotflow.planning import Goal, PlannerConfig, SearchGraph
from knotflow.planning.branches import ACT, ARRANGE, Branch, Node
from knotflow.planning.proposals import UNDONE, Proposals, together
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW
from knotflow.topology import TopologicalState, Undo

LOOP = TopologicalState.parse("2o1+")


class Critic:
    """Values every action alike, and takes down what it is asked."""

    def __init__(self, lacks):
        self.lacks, self.asked = lacks, []

    def sample(self, points, action, count, rng):
        self.asked.append(action)
        return np.tile((SPLINE_LOW + SPLINE_HIGH) / 2, (count, 1))

    def values(self, points, actions, rng):
        self.asked.extend(actions)
        return np.full(len(actions), 0.7)


@pytest.fixture
def node(shape_of):
    graph = SearchGraph(Goal.named("overhand").dag)
    return Node(shape_of(LOOP), LOOP, graph.distance(LOOP), graph.edges_from(LOOP))


@pytest.mark.parametrize("lacks", [{"undo"}, set()])
def test_undoing_is_aimed_for_a_sampler_that_does_not_know_it(node, lacks):
    critic, rng = Critic(lacks), np.random.default_rng(0)
    proposals = Proposals(critic, Goal.named("overhand"), PlannerConfig(), rng)
    undoing = np.array([isinstance(action, Undo) for action, _ in node.edges])
    assert 0 < undoing.sum() < len(undoing)
    proposals.appraise([node])
    np.testing.assert_array_equal(node.values[~undoing], 0.7)
    np.testing.assert_array_equal(node.values[undoing], UNDONE if lacks else 0.7)

    edge = int(np.flatnonzero(undoing)[0])
    branches = [Branch(node, edge, ACT), Branch(node, edge, ARRANGE)]
    splines = np.concatenate(list(proposals.splines(branches)))
    assert splines.shape == (2, 6)
    assert (splines >= SPLINE_LOW).all() and (splines <= SPLINE_HIGH).all()
    assert any(isinstance(action, Undo) for action in critic.asked) == (not lacks)


def test_the_sampler_is_asked_once_for_branches_that_are_alike(node):
    critic = Critic(set())
    proposals = Proposals(critic, Goal.named("overhand"), PlannerConfig(), np.random.default_rng(0))
    edges = [0, 1, 0, 1, 0]
    branches = together([Branch(node, edge, ACT) for edge in edges])
    assert [branch.edge for branch in branches] == sorted(edges)
    assert [len(splines) for splines in proposals.splines(branches)] == [3, 2]
    assert critic.asked == [node.edges[0][0], node.edges[1][0]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("value", "rule", "share"),
    [(0.1, "posterior", 0.5), (0.7, "posterior", 0.0), (0.1, "paper", 0.0)],
)
def test_guesses_are_mixed_in_where_the_critic_sees_hardly_a_way(node, value, rule, share):
    config = PlannerConfig(rule=rule, guess_fraction=0.5, guess_below_value=0.3)
    rng = np.random.default_rng(0)
    proposals = Proposals(Critic(set()), Goal.named("overhand"), config, rng)
    node.values = np.full(len(node.edges), value)
    (splines,) = proposals.splines([Branch(node, 0)] * 200)
    guessed = (splines != (SPLINE_LOW + SPLINE_HIGH) / 2).any(axis=1)
    assert guessed.mean() == pytest.approx(share, abs=0.12)


@pytest.mark.slow
def test_a_shape_that_is_grown_again_is_to_be_another_one(node):
    proposals = Proposals(
        Critic(set()), Goal.named("overhand"), PlannerConfig(), np.random.default_rng(0)
    )
    node.values = np.full(len(node.edges), 0.9)
    node.successes[ACT, 0] = 1
    for edge, share in ((0, 0.5), (1, 0.0)):
        (splines,) = proposals.splines([Branch(node, edge)] * 200)
        guessed = (splines != (SPLINE_LOW + SPLINE_HIGH) / 2).any(axis=1)
        assert guessed.mean() == pytest.approx(share, abs=0.12)

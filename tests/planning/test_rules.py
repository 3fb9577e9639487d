"""The paper's rule, what values nodes, and what is asked of a sampler."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.planning import Goal, PlannerConfig, plan_knot
from knotflow.planning.nodes import Node
from knotflow.planning.proposals import Proposals, clearance
from knotflow.planning.rules import node_probabilities
from knotflow.simulation import straight
from knotflow.topology import TopologicalState, segment_intervals

TRIVIAL = TopologicalState.trivial()


def path_states(goal):
    states, state = [TRIVIAL], TRIVIAL
    while edges := goal.dag.edges_from(state):
        state = edges[0][1]
        states.append(state)
    return states


def tree(goal, world, of):
    """Nodes of a tree: the root, then one for each state and number of failures."""
    points, dag = straight(world.config.rope), goal.dag
    return [
        Node(points, state, dag.distance(state), dag.edges_from(state), failures=failures)
        for state, failures in [(TRIVIAL, 0), *of]
    ]


def test_nearer_nodes_are_likelier_by_the_bias_per_edge(world, path_goal):
    _, one, two, _ = path_states(path_goal)
    nodes = tree(path_goal, world(), [(one, 0), (two, 0), (one, 0)])
    chances = node_probabilities(nodes, PlannerConfig(bias=4.0))
    np.testing.assert_allclose(chances, np.array([1, 4, 16, 4]) / 25)


def test_failures_do_not_count_by_default_and_count_when_asked(world, path_goal):
    _, one, two, _ = path_states(path_goal)
    nodes = tree(path_goal, world(), [(one, 3), (two, 2)])
    paper = node_probabilities(nodes, PlannerConfig(bias=4.0))
    np.testing.assert_allclose(paper, np.array([1, 4, 16]) / 21)
    option = node_probabilities(nodes, PlannerConfig(bias=4.0, failure_discount=0.5))
    np.testing.assert_allclose(option, np.array([1, 0.5, 4]) / 5.5)


def test_many_failures_do_not_underflow(world, path_goal):
    _, one, _, _ = path_states(path_goal)
    nodes = tree(path_goal, world(), [(one, 100_000)])
    nodes[0].failures = 100_000
    chances = node_probabilities(nodes, PlannerConfig(failure_discount=0.5))
    assert chances.sum() == pytest.approx(1.0)


class Blind:
    def sample(self, points, action, count, rng):
        raise AssertionError("nobody asked for splines")


def evaluate(nodes, goal, sampler, config):
    Proposals(sampler, goal, config, np.random.default_rng(0)).evaluate(nodes)


class Critic(Blind):
    """Values the first edge it is asked for highest."""

    def __init__(self):
        self.asked = []

    def values(self, points, actions, rng):
        self.asked.append([str(action) for action in actions])
        return np.linspace(0.9, 0.1, len(actions))


def test_edges_and_nodes_of_higher_value_are_likelier(world):
    goal = Goal.named("overhand")
    nodes = tree(goal, world(), [(TRIVIAL, 0)])
    config, critic = PlannerConfig(rule="paper", value_bias=2.0), Critic()
    evaluate(nodes, goal, critic, config)
    (asked,) = critic.asked
    assert asked == [str(action) for node in nodes for action, _ in node.edges]
    assert (np.diff(nodes[0].values) < 0).all()
    first, second = node_probabilities(nodes, config)
    assert first > second > 0


def test_paper_rule_asks_no_critic(world):
    goal, critic = Goal.named("overhand"), Critic()
    nodes = tree(goal, world(), [])
    evaluate(nodes, goal, critic, PlannerConfig(rule="paper"))
    assert not critic.asked
    np.testing.assert_allclose(nodes[0].values, 1.0)


def test_without_critic_all_edges_have_value_one(world):
    goal, config = Goal.named("overhand"), PlannerConfig(rule="paper", value_bias=2.0)
    nodes = tree(goal, world(), [])
    evaluate(nodes, goal, Blind(), config)
    np.testing.assert_allclose(nodes[0].values, 1.0)


def test_missing_capability_is_not_used(world):
    goal, critic = Goal.named("overhand"), Critic()
    critic.capabilities = set()
    nodes = tree(goal, world(), [])
    evaluate(nodes, goal, critic, PlannerConfig())
    assert not critic.asked
    np.testing.assert_allclose(nodes[0].values, 1.0)  # one segment has all the room there is


def test_clearance_is_relative_length_of_two_shortest_segments(world, shape_of):
    assert clearance(straight(world.config.rope)) == pytest.approx(1.0)
    rope = shape_of(TopologicalState.parse("1o3+4o2+"))
    lengths = np.sort(np.diff(segment_intervals(rope), axis=1).ravel())
    assert clearance(rope) == pytest.approx((lengths[0] + lengths[1]) / 2 * 5)
    assert 0.0 < clearance(rope) < 1.0


def test_next_value_is_used_for_all_but_the_last_action(world, path_goal):
    class Foreseeing(world):
        def __init__(self):
            super().__init__()
            self.foreseen = []

        def sample_for_next(self, points, action, count, rng):
            self.foreseen.append(str(action))
            return self.sample(points, action, count, rng)

    for config in (
        PlannerConfig(use_next_value=False),
        PlannerConfig(),
        PlannerConfig(rule="paper"),
    ):
        sampler, rng = Foreseeing(), np.random.default_rng(0)
        plan_knot(straight(world.config.rope), path_goal, sampler, sampler, rng, config)
        assert sampler.foreseen == (["R1(0,1,1)", "C(0,1,1)"] if config.use_next_value else [])
    assert [action for _, action, _ in sampler.requests] == [*sampler.foreseen, "C(2,0,1)"]

"""The two rules, what values nodes, and what is asked of a sampler."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import Goal, PlannerConfig, parse_goal, plan_knot
from knotflow.planning.proposals import Proposals, clearance
from knotflow.planning.rules import (
    ACT,
    ARRANGE,
    MAX_GAINS,
    Expansion,
    Node,
    PosteriorRule,
    ReservationPrices,
    node_probabilities,
)
from knotflow.simulation import straight
from knotflow.topology import Arrange, TopologicalState, segment_intervals

TRIVIAL = TopologicalState.trivial()
MET = TopologicalState.parse("2o1+")


def root(goal, world):
    return Node(
        straight(world.config.rope),
        TRIVIAL,
        goal.dag.distance(TRIVIAL),
        edges=goal.dag.edges_from(TRIVIAL),
    )


def test_chances_double_their_exponent_with_each_stage():
    chances = node_probabilities([3, 2, 1, 2])
    expected = np.exp(2 * np.array([1.0, 2.0, 4.0, 2.0]))
    np.testing.assert_allclose(chances, expected / expected.sum())
    np.testing.assert_allclose(node_probabilities([9, 8, 7, 8]), chances)


def test_chances_of_long_paths_are_finite():
    chances = node_probabilities([500, *range(500, 0, -1)])
    assert chances[-1] == pytest.approx(1.0) and chances.sum() == pytest.approx(1.0)


def test_stages_are_those_of_the_path_that_is_followed():
    """R2 leads to this state at once, but the path takes two actions."""
    path, state = "R1(0,1,-1) C(0,2,1)", TopologicalState.parse("1o4+2o3-")
    assert Goal.state(state).dag.distance(TRIVIAL) == 1
    assert parse_goal(path).dag.distance(TRIVIAL) == 2


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


def test_paper_rule_asks_no_critic(world):
    goal, critic = parse_goal("overhand"), Critic()
    nodes = [root(goal, world)]
    evaluate(nodes, goal, critic, PlannerConfig(rule="paper"))
    assert not critic.asked
    np.testing.assert_allclose(nodes[0].values, 1.0)


def test_missing_capability_is_not_used(world):
    goal, critic = parse_goal("overhand"), Critic()
    critic.capabilities = set()
    nodes = [root(goal, world)]
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


@pytest.mark.parametrize("size", [1, 2, 30])
def test_reservation_price_is_where_opening_saves_its_cost(size):
    rng = np.random.default_rng(size)
    contents, price = rng.exponential(5.0, size), rng.exponential(4.0, 100)
    index = ReservationPrices(contents).at(price)
    saved = np.maximum(index[:, None] - contents, 0.0).mean(axis=1)
    np.testing.assert_allclose(saved, price)


def test_reservation_price_of_certain_content_is_cost_plus_content():
    prices = ReservationPrices(np.array([3.0])).at(np.array([1.0, 2.5]))
    np.testing.assert_allclose(prices, [4.0, 5.5])


def node(world, goal, state, values, arranged=None):
    dag = goal.dag
    one = Node(straight(world.config.rope), state, dag.distance(state), dag.edges_from(state))
    one.values = np.array(values, float)
    one.arranged_values = one.values if arranged is None else np.array(arranged, float)
    return one


def chosen(goal, nodes, count=1, **config):
    rule = PosteriorRule(PlannerConfig(**config), goal.dag)
    for one in nodes:
        rule.add(one)
    return rule.choose(count)


def test_shape_of_highest_value_comes_first(world, path_goal):
    shapes = [node(world, path_goal, TRIVIAL, [value]) for value in (0.3, 0.9, 0.6)]
    (branch,) = chosen(path_goal, shapes)
    assert branch.node is shapes[1] and branch.kind == ACT


def test_batch_is_spread_over_shapes(world, path_goal):
    shapes = [node(world, path_goal, TRIVIAL, [value]) for value in (0.8, 0.7, 0.05)]
    counts = Counter(id(branch.node) for branch in chosen(path_goal, shapes, 8, arranging=0))
    assert counts[id(shapes[0])] >= counts[id(shapes[1])] >= 3
    assert sum(counts.values()) == 8 == sum(shape.tries.sum() for shape in shapes)


def test_arranging_is_chosen_where_it_raises_the_value(world, path_goal):
    (branch,) = chosen(path_goal, [node(world, path_goal, TRIVIAL, [0.05], [0.9])])
    assert branch.kind == ARRANGE and str(branch.action) == "arrange for R1(0,1,1)"
    assert branch.goal == TRIVIAL
    for shape, most in (
        (node(world, path_goal, TRIVIAL, [0.8], [0.9]), 3),
        (node(world, path_goal, TRIVIAL, [0.05], [0.9]), 0),
    ):
        (branch,) = chosen(path_goal, [shape], arranging=most)
        assert branch.kind == ACT


@pytest.mark.parametrize(("reached", "kind"), [(0.15, ACT), (0.3, ARRANGE)])
def test_arranging_goes_on_while_it_gains_what_was_predicted(world, path_goal, reached, kind):
    shape = node(world, path_goal, TRIVIAL, [0.15], [0.3])
    arranged = node(world, path_goal, TRIVIAL, [reached])
    rule = PosteriorRule(PlannerConfig(), path_goal.dag)
    rule.add(shape)
    for _ in range(MAX_GAINS):
        shape.tries[ARRANGE] += 1
        rule.learn(Expansion(shape, 0, ARRANGE), arranged)
    (branch,) = rule.choose(1)
    assert branch.kind == kind


def test_arranging_that_loses_the_state_is_given_up(world, path_goal):
    shape = node(world, path_goal, TRIVIAL, [0.2], [0.9])
    rule = PosteriorRule(PlannerConfig(), path_goal.dag)
    rule.add(shape)
    kinds = []
    for _ in range(20):
        (branch,) = rule.choose(1)
        kinds.append(branch.kind)
        rule.learn(branch, None)
    assert kinds[0] == ARRANGE and ACT in kinds


def test_an_arranged_shape_inherits_what_was_tried_of_the_action(world, path_goal, plan):
    shape, arranged = (node(world, path_goal, TRIVIAL, [0.5]) for _ in range(2))
    shape.tries[:], shape.successes[:] = 7, 2
    action = Arrange(path_goal.dag.edges_from(TRIVIAL)[0][0])
    arranged.parent, arranged.step = shape, replace(plan.steps[0], action=action)
    PosteriorRule(PlannerConfig(), path_goal.dag).add(arranged)
    assert (arranged.tries[ACT], arranged.successes[ACT]) == (7, 2)
    assert arranged.tries[ARRANGE] == arranged.successes[ARRANGE] == 0


@pytest.mark.parametrize("arranged", [False, True])
def test_an_edge_is_worth_the_shapes_that_were_met_at_its_end(world, plan, arranged):
    """Those that were arranged first say nothing of what the edge leads to."""
    goal = parse_goal("overhand")
    edges = goal.dag.edges_from(TRIVIAL)
    (last,) = (row for row, (_, state) in enumerate(edges) if state == MET)
    start = node(world, goal, TRIVIAL, np.full(len(edges), 0.5))
    met = node(world, goal, MET, np.full(len(goal.dag.edges_from(MET)), 0.9))
    if arranged:
        met.parent = node(world, goal, MET, met.values)
        met.step = replace(plan.steps[0], action=Arrange(met.edges[0][0]))
    rule = PosteriorRule(PlannerConfig(arranging=0), goal.dag)
    rule.add(start)
    rule.add(met)
    first = next(one for one in rule.choose(40) if one.node is start)
    assert first.edge == (0 if arranged else last)


class Tight:
    """Every second loop is too tight to go on from, and none can tell which."""

    def __init__(self, world):
        self.world, self.config, self.from_shape = world, world.config, Counter()

    def sample(self, points, action, count, rng):
        tight = bool(np.floor(points[0, 0] * 1e9) % 2) and len(set(points[:, 1])) > 1
        self.world.chance = 0.0 if tight else 0.9
        self.from_shape[points.tobytes()] += count
        return self.world.sample(points, action, count, rng)

    def execute(self, points, splines):
        rollouts = self.world.execute(points, splines)
        # Each end is a shape of its own.
        for row, spline in enumerate(splines):
            rollouts.end_points[row, :, 0] += np.floor(spline[1] * 1e3) * 1e-9
        return rollouts


@pytest.mark.parametrize("batch", [1, 8])
@pytest.mark.parametrize("seed", range(4))
def test_dead_ends_are_abandoned(world, path_goal, seed, batch):
    tight = Tight(world())
    rng = np.random.default_rng(seed)
    config = PlannerConfig(batch=batch, max_branches=300, arranging=0)
    plan = plan_knot(straight(world.config.rope), path_goal, tight, tight, rng, config)
    assert plan.solved
    root = straight(world.config.rope).tobytes()
    tries = [count for shape, count in tight.from_shape.items() if shape != root]
    assert max(tries) <= 12 + batch


def test_evidence_finds_the_path_that_works(world):
    goal = parse_goal("overhand")

    class OnlyOne(world):
        def sample(self, points, action, count, rng):
            self.chance = 0.8 if str(action) in ("R1(0,1,-1)", "C(2,1,-1)", "C(2,0,-1)") else 0.0
            return super().sample(points, action, count, rng)

    path = parse_goal("R1(0,1,-1) C(2,1,-1) C(2,0,-1)")
    assert path.states <= goal.states
    rng, sampler = np.random.default_rng(0), OnlyOne()
    plan = plan_knot(straight(world.config.rope), goal, sampler, sampler, rng)
    assert [str(action) for action in plan.actions] == ["R1(0,1,-1)", "C(2,1,-1)", "C(2,0,-1)"]
    assert plan.branches < 150

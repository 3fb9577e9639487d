"""The search goes on until a plan ties in most worlds, and says in how many it does."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.planning import (
    KnotPlan,
    PlannerConfig,
    SearchStoppedError,
    SurvivalConfig,
    TreeSearch,
    survival,
)
from knotflow.planning.rules import Node
from knotflow.planning.survival import SurvivalSearch
from knotflow.simulation import Rollouts, straight


class Brittle:
    """Its splines succeed in the nominal world, a share of them, sturdy, in slow worlds too."""

    def __init__(self, world, sturdy):
        self.world, self.config, self.sturdy = world, world.config, sturdy
        self.moves = {}

    def sample(self, points, action, count, rng):
        splines = self.world.sample(points, action, count, rng)
        self.moves |= {spline.tobytes(): rng.random() < self.sturdy for spline in splines}
        return splines

    def execute(self, points, splines, worlds=None, controls=None):
        rollouts = self.world.execute(points, splines)
        for row, spline in enumerate(splines if worlds else ()):
            if worlds[row].pace < 1 and not self.moves.get(spline.tobytes(), True):
                rollouts.end_points[row] = points[row]
        return rollouts


def survive(
    brittle, goal, told=lambda update: None, budget=1000, stoppable=False, early=False, **options
):
    rng = np.random.default_rng(0)
    start, config = straight(brittle.config.rope), PlannerConfig(max_branches=budget)
    search = TreeSearch(start, goal, brittle, brittle, rng, config)
    updates = []

    def progress(update):
        updates.append(update)
        told(update)

    surviving = SurvivalSearch(search, SurvivalConfig(**options), rng, early)
    return surviving.run(progress, stoppable), [one.survival for one in updates]


@pytest.mark.slow
def test_the_search_goes_on_until_a_plan_ties_in_most_worlds(world, path_goal):
    plan, survivals = survive(Brittle(world(), 0.4), path_goal, least=0.9)
    assert plan.solved
    assert (plan.worlds, plan.survived) == (16, (16, 16, 16))
    assert plan.branches > 3 + 3 * 16  # the first plan, in all worlds
    assert survivals == sorted(survivals)
    assert survivals[-1] >= 0.9


def test_it_keeps_its_best_plan_when_the_budget_is_spent(world, path_goal):
    plan, survivals = survive(Brittle(world(), 0.0), path_goal, budget=200)
    assert plan.solved
    assert plan.reason == "200 splines were simulated"
    assert plan.worlds > plan.survived[0] >= plan.survived[1] >= plan.survived[2] > 0
    assert max(survivals) < 0.9


@pytest.mark.parametrize(("late", "simulated"), [(0, 0), (6, 8)])
def test_it_ends_in_time_and_still_measures_its_plan(
    world, path_goal, monkeypatch, late, simulated
):
    """Its time is over after the first plan, or while this is carried through four worlds."""
    brittle = Brittle(world(), 1.0)
    draws, used = drawn_worlds(brittle, monkeypatch)
    monkeypatch.setattr(TreeSearch, "is_late", lambda _: bool(draws) and len(used) >= late)
    plan, _ = survive(brittle, path_goal, worlds=4)
    assert plan.solved and plan.reason.endswith(" s passed") and plan.survived == (4, 4, 4)
    chosen, measuring = draws
    assert len(used) == simulated + 3 * len(measuring)
    assert all(one in chosen for one in used[:simulated])


@pytest.mark.parametrize("ends", [SearchStoppedError, KeyboardInterrupt])
def test_one_who_stops_it_gets_the_best_plan_so_far(world, path_goal, ends):
    def stop(update):
        if update.survival:
            raise ends

    plan, _ = survive(Brittle(world(), 0.0), path_goal, stop, stoppable=True)
    assert plan.solved and plan.worlds == 16
    assert plan.reason == "the search was stopped"


def test_an_interruption_is_not_swallowed_where_nobody_asked_for_it(world, path_goal):
    def stop(update):
        if update.survival:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        survive(Brittle(world(), 0.0), path_goal, stop)


def test_one_who_stops_it_before_there_is_a_plan_gets_none(world, path_goal):
    def stop(update):
        raise SearchStoppedError

    with pytest.raises(SearchStoppedError):
        survive(Brittle(world(), 1.0), path_goal, stop)


def test_a_plan_that_is_sure_at_once_costs_its_worlds_alone(world, path_goal):
    plan, survivals = survive(Brittle(world(), 1.0), path_goal, worlds=4)
    assert plan.branches == 3 + 3 * 3 * 4  # the worlds that it was chosen by, and twice as many
    assert plan.survived == (4, 4, 4)
    assert not any(survivals)


def test_a_plan_that_can_no_longer_become_unsure_may_be_taken(world, path_goal):
    """Of 24 worlds 6 may be lost, and 4 are tested at once."""
    plans = [
        survive(Brittle(world(), 1.0), path_goal, worlds=8, early=early)[0]
        for early in (False, True)
    ]
    assert [plan.branches for plan in plans] == [3 + 3 * 24, 3 + 3 * 20]
    assert plans[0].reason == plans[1].reason


def test_how_sure_a_plan_is_is_said_and_stored(world, path_goal):
    plan, _ = survive(Brittle(world(), 1.0), path_goal)
    assert "ties in 16 of 16 other worlds (95 % interval 81 to 100 %)" in plan.summary()
    assert '"survival_interval": [0.8064, 1.0]' in plan.to_json()
    read = KnotPlan.from_json(plan.to_json())
    assert (read.worlds, read.survived) == (16, (16, 16, 16))
    assert "other worlds" not in replace(plan, worlds=0).summary()


def test_the_first_plan_is_that_of_a_search_without_worlds(world, path_goal):
    brittle = Brittle(world(), 0.0)
    rng = np.random.default_rng(0)
    first = TreeSearch(straight(brittle.config.rope), path_goal, brittle, brittle, rng).run()
    plan, _ = survive(Brittle(world(), 0.0), path_goal, least=0.0)
    np.testing.assert_array_equal(plan.splines, first.splines)


def test_it_ends_where_no_further_spline_is_in_reach(world, path_goal):
    class OnlyTheFirstPlan:
        """Reaches what is tried until a plan is found, and nothing after it."""

        found = False

        def may_follow(self, points, splines):
            return np.full(len(splines), not self.found)

        def first_failed(self, plan):
            self.found = True

    rng, brittle = np.random.default_rng(0), Brittle(world(), 0.0)
    start, config = straight(brittle.config.rope), PlannerConfig(max_branches=100)
    reach = OnlyTheFirstPlan()
    search = TreeSearch(start, path_goal, brittle, brittle, rng, config, reach=reach)
    plan = SurvivalSearch(search, SurvivalConfig(), rng).run()
    assert plan.solved and len(plan.steps) == 3
    assert "in the arm's reach" in plan.reason


def drawn_worlds(brittle, monkeypatch):
    """The worlds of each draw, and those of each simulated spline, by identity."""
    draws, used = [], []
    drawing, executing = survival.draw_worlds, brittle.execute

    def draw(*args, **options):
        draws.append(drawing(*args, **options))
        return draws[-1]

    def execute(points, splines, worlds=None, controls=None):
        used.extend(worlds or [])
        return executing(points, splines, worlds, controls)

    monkeypatch.setattr(survival, "draw_worlds", draw)
    monkeypatch.setattr(brittle, "execute", execute)
    return draws, used


def test_a_plan_is_confirmed_and_measured_in_worlds_of_its_own(world, path_goal, monkeypatch):
    brittle = Brittle(world(), 1.0)
    draws, used = drawn_worlds(brittle, monkeypatch)
    plan, _ = survive(brittle, path_goal, worlds=4)
    chosen, *confirming, measuring = draws
    assert plan.survived == (4, 4, 4) and len(confirming) == 2
    for some in (chosen, *confirming, measuring):
        for one in some:  # each of three steps once
            assert sum(one is other for other in used) == 3


def test_losses_in_the_worlds_it_was_chosen_by_count(world, path_goal, monkeypatch):
    class Lossy(Brittle):
        """Loses one world of the first four, and three of the next eight."""

        def execute(self, points, splines, worlds=None, controls=None):
            rollouts = self.world.execute(points, splines)
            lost = [one for some, n in zip(draws, (1, 2, 1), strict=False) for one in some[:n]]
            for row, one in enumerate(worlds or []):
                if any(one is other for other in lost):
                    rollouts.end_points[row] = points[row]
            return rollouts

    lossy = Lossy(world(), 1.0)
    draws, _ = drawn_worlds(lossy, monkeypatch)
    plan, _ = survive(lossy, path_goal, worlds=4, least=0.75)
    assert plan.solved and len(draws) > 4  # 4 of 12 are more than a quarter: another is looked for


@pytest.mark.parametrize("stoppable", [True, False])
def test_ctrl_c_in_the_first_worlds_leaves_the_plan_to_who_asked(world, path_goal, stoppable):
    class Interrupted(Brittle):
        pressed = 0

        def execute(self, points, splines, worlds=None, controls=None):
            if worlds and not self.pressed:
                self.pressed += 1
                raise KeyboardInterrupt
            return super().execute(points, splines, worlds, controls)

    if stoppable:
        plan, _ = survive(Interrupted(world(), 1.0), path_goal, stoppable=True)
        assert plan.solved and plan.reason == "the search was stopped" and plan.worlds == 16
    else:
        with pytest.raises(KeyboardInterrupt):
            survive(Interrupted(world(), 1.0), path_goal)


def test_ctrl_c_while_it_is_measured_leaves_the_plan(world, path_goal):
    class Interrupted(Brittle):
        def execute(self, points, splines, worlds=None, controls=None):
            if worlds:
                raise KeyboardInterrupt
            return super().execute(points, splines, worlds, controls)

    plan, _ = survive(Interrupted(world(), 1.0), path_goal, stoppable=True)
    assert plan.solved and plan.worlds == 0 and plan.survived == ()


def test_steps_are_followed_blindly_and_a_lost_world_stays_lost(world, plan):
    steps, rows = iter(plan.steps), []

    class Forgiving(world):
        """The first step fails in the second world; the others end as planned, whatever was."""

        def execute(self, points, splines, worlds, controls):
            step = next(steps)
            np.testing.assert_array_equal(controls, [step.controls(plan.radius)] * len(points))
            ends = np.repeat(step.end[None], len(points), axis=0)
            if not rows:
                ends[1] = step.start
            rows.append(worlds)
            return Rollouts.between(points, ends)

    assert survival.surviving(plan.steps, Forgiving(), "abc") == (2, 2, 2)
    assert rows == [list("abc"), ["a", "c"], ["a", "c"]]


class Grown:
    """A search whose nodes are given, and which grows four children of other values."""

    def __init__(self, nodes, child):
        self.nodes, self.child = nodes, child

    def grow_for(self, expansion, ropes, near, count):
        self.asked = expansion.node, ropes, near
        return [self.child(value) for value in (0.3, 0.9, 0.1, 0.6)]


def test_the_tree_grows_where_survival_and_value_are_highest(plan, path_goal, shape_of):
    first, second = (step.end_state for step in plan.steps[:2])

    def node(state, value, parent=None, step=None):
        dag = path_goal.dag
        one = Node(shape_of(state), state, dag.distance(state), dag.edges_from(state), parent, step)
        one.values = np.full(len(one.edges), value)
        return one

    root = node(plan.start_state, 0.6)
    sure, best, likely = (node(first, value) for value in (0.2, 0.9, 0.92))
    steps = [replace(plan.steps[1], spline=np.full(6, share)) for share in (0.2, 0.4, 0.1)]
    children = [node(second, 0.0, best, step) for step in steps]
    grown = Grown([root], lambda value: node(second, value))
    search = SurvivalSearch(grown, SurvivalConfig(worlds=4, tested=2), np.random.default_rng(0))
    intact = np.array([True, False, True, False])
    ropes = np.arange(4)[:, None, None] + best.points
    shares = {sure: 0.9, best: 0.5, likely: 0.48}
    shares |= dict(zip(children, (0.2, 0.4, 0.1), strict=True))
    search._ropes |= {one: survival.Ropes(ropes, intact, share) for one, share in shares.items()}
    search._children[best, second] = children
    tested = search._next(0.45)
    assert grown.asked[0] is best
    np.testing.assert_array_equal(grown.asked[1], ropes[intact])
    np.testing.assert_array_equal(grown.asked[2], steps[1].spline)
    assert [one.values[0] for one in tested] == [0.6, 0.9]
    root.values[:] = likely.values[:] = 0.1
    search._ropes |= {one: replace(search._ropes[one], survival=0.0) for one in children}
    search._next(0.45)  # for what was tried there did not survive
    assert grown.asked[0] is sure
    root.values[:] = 0.6
    search._tries.clear()
    search._next(0.5)  # no plan by way of `best` would be better
    assert grown.asked[0] is root


@pytest.mark.parametrize(
    ("name", "value"),
    [("worlds", -1), ("batch", 0), ("tested", 0), ("screened", 0), ("least", 1.5)],
)
def test_settings_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=f"survival.{name} .*{value}"):
        SurvivalConfig(**{name: value})

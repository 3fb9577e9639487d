"""Only what enough perturbed ropes survive is kept."""

from types import SimpleNamespace

import numpy as np
import pytest

from knotflow.planning import PlannerConfig, plan_knot
from knotflow.planning.branches import FRAGILE, Node
from knotflow.planning.ensemble import REACH, Ensemble
from knotflow.simulation import straight

SPLINE = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.2])


class Ends:
    """A simulator in which every rope ends in the same shape."""

    def __init__(self, config, end):
        self.config, self.end, self.splines = config, end, []

    def execute(self, points, splines):
        self.splines.extend(splines)
        ends = np.repeat(self.end[None], len(points), axis=0)
        return SimpleNamespace(end_points=ends, diverged=np.zeros(len(points), bool))


@pytest.fixture
def states(path_goal):
    """The state of a straight rope, and the one of the path's first action."""
    (edge,) = path_goal.dag.edges_from(next(iter(path_goal.dag.graph)))
    return next(iter(path_goal.dag.graph)), edge[1]


def ensemble(world, ends, **config):
    ropes = [Ends(world.config, end) for end in ends]
    settings = PlannerConfig(ensemble=len(ropes), ensemble_level=0, **config)
    return ropes, Ensemble(world.config, settings, np.random.default_rng(0), ropes)


def child_of(parent, points, state):
    return Node(points, state, 0, (), parent, SimpleNamespace(spline=SPLINE))


def test_a_branch_is_kept_if_enough_ropes_reach_its_state(world, shape_of, states):
    before, after = (shape_of(state) for state in states)
    ropes, drawn = ensemble(world, [after, before, after], survival=1.0)
    root = Node(before, states[0], 1)
    drawn.lay(root)
    child = child_of(root, after, states[1])
    assert drawn.survivors([child]) == [child]
    assert [shape is not None for shape in child.ensemble] == [True, False, True]
    assert child.left == 2 and child.survival == pytest.approx(2 / 3)
    grandchild = child_of(child, after, states[1])
    assert drawn.survivors([grandchild]) == [grandchild]
    assert [len(rope.splines) for rope in ropes] == [2, 1, 2]  # what is lost stays lost

    drawn.surpass(child)
    assert drawn.falls_short(child) and not drawn.falls_short(root)
    assert drawn.survivors([child_of(root, after, states[1])]) == []


def test_ropes_are_not_tried_where_too_many_are_lost(world, shape_of, states):
    before, after = (shape_of(state) for state in states)
    ropes, drawn = ensemble(world, [before, before, after, after])
    root = Node(before, states[0], 1)
    drawn.lay(root)
    found = child_of(root, after, states[1])
    assert drawn.survivors([found]) == [found]
    drawn.surpass(found)
    assert drawn.survivors([child_of(root, after, states[1])]) == []
    assert [len(rope.splines) for rope in ropes] == [2, 2, 1, 1]


@pytest.mark.parametrize(("survival", "suffices"), [(0.6, True), (0.7, False)])
def test_a_plan_suffices_if_its_share_of_the_ropes_is_left(
    world, shape_of, states, survival, suffices
):
    before, after = (shape_of(state) for state in states)
    _, drawn = ensemble(world, [after, before, after], survival=survival)
    root = Node(before, states[0], 1)
    drawn.lay(root)
    child = child_of(root, after, states[1])
    drawn.survivors([child])
    assert drawn.suffices(child) is suffices


def test_a_rope_is_grasped_where_the_planners_was(world, shape_of, states):
    before, after = (shape_of(state) for state in states)
    (rope,), drawn = ensemble(world, [after])
    root = Node(before, states[0], 1)
    link = world.config.rope.link_length
    root.ensemble = (before + [3 * link, 0.0, 0.0],)
    assert drawn.survivors([child_of(root, after, states[1])])
    assert rope.splines[0][0] == pytest.approx(SPLINE[0] - 2.5 / world.config.rope.links)
    root.ensemble = (before + [0.0, 1.1 * REACH, 0.0],)
    assert not drawn.survivors([child_of(root, after, states[1])])
    assert len(rope.splines) == 1


def test_a_rope_stays_as_far_off_the_fingers_as_it_was_caught(world, shape_of, states):
    before, after = (shape_of(state) for state in states)
    (rope,), drawn = ensemble(world, [after])
    root = Node(before, states[0], 1)
    root.ensemble = (before + [0.0, 0.6 * REACH, 0.0],)
    assert drawn.survivors([child_of(root, after, states[1])])
    off = [0.0, 0.0, 0.6 * REACH, 0.0, 0.0, 0.6 * REACH]
    np.testing.assert_allclose(rope.splines[0], SPLINE + off, atol=1e-9)


def search(world, path_goal, **config):
    points = straight(world.config.rope)
    settings = PlannerConfig(ensemble=2, ensemble_level=0, max_branches=12, **config)
    return plan_knot(points, path_goal, world, world, np.random.default_rng(0), settings)


def test_ropes_like_the_planners_change_nothing(world, path_goal, monkeypatch):
    perfect = world()
    monkeypatch.setattr("knotflow.planning.ensemble.RopeSimulator", lambda config: perfect)
    plan = search(perfect, path_goal)
    assert plan.solved and plan.branches == 3
    assert plan.reason == "the goal was reached, and by 2 of 2 perturbed ropes"


def test_a_search_goes_on_from_a_plan_that_too_few_ropes_execute(world, path_goal, monkeypatch):
    perfect = world()
    ropes = iter([perfect, Ends(world.config, straight(world.config.rope))])
    monkeypatch.setattr("knotflow.planning.ensemble.RopeSimulator", lambda config: next(ropes))
    plan = search(perfect, path_goal, survival=1.0)
    assert plan.solved and plan.branches == 12
    reached = "the goal was reached, and by 1 of 2 perturbed ropes"
    assert plan.reason == f"{reached}; 12 branches were simulated"


def test_what_no_other_rope_does_makes_no_plan(world, path_goal, monkeypatch):
    stiff = Ends(world.config, straight(world.config.rope))
    monkeypatch.setattr("knotflow.planning.ensemble.RopeSimulator", lambda config: stiff)
    plan = search(world(), path_goal, arranging=0)
    assert not plan.solved and plan.steps == ()
    assert {tried.outcome for tried in plan.tried} == {FRAGILE}
    assert not any(tried.success for tried in plan.tried)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ({"ensemble": -1}, "planner.ensemble"),
        ({"survival": 0.0}, "planner.survival"),
        ({"ensemble_level": 3}, "0, 1 or 2: 3"),
    ],
)
def test_senseless_ensembles_are_refused(bad, says):
    with pytest.raises(ValueError, match=says):
        PlannerConfig(**bad)

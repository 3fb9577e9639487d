"""Tied ropes and states are of the knot types that an independent library finds."""

from pathlib import Path

import numpy as np
import pytest

from knotflow.planning import KnotPlan
from knotflow.topology import TopologicalState, knot
from knotflow.topology.draw import draw

from .knot_types import closed_curve, expected_type, knot_type

REPOSITORY = Path(__file__).parents[2]
TYPES = {
    "unknot": {"0_1"},
    "overhand": {"+3_1", "-3_1"},
    "figure_eight": {"4_1"},
    "pentagram": {"+5_1", "-5_1"},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TYPES)
def test_every_state_of_a_named_knot_is_that_knot(name):
    assert {expected_type(state) for state in knot(name)} == TYPES[name]


@pytest.mark.slow
def test_sign_of_overhand_is_its_chirality():
    right = TopologicalState.parse("4o1+2o5+6o3+")
    assert (expected_type(right), expected_type(right.mirrored())) == ("+3_1", "-3_1")


def test_closure_runs_above_everything():
    points = draw(TopologicalState.parse("1o3+4o2+"))
    closed = closed_curve(points)
    np.testing.assert_array_equal(closed[0], closed[-1])
    np.testing.assert_array_equal(closed[: len(points)], points)
    assert closed[len(points) : -1, 2].min() > points[:, 2].max() + 0.05


@pytest.mark.slow
def test_untied_states_are_unknots_even_with_an_end_inside():
    for text in ("2o1+", "1o4+3o2-", "1o3+4o2+"):
        assert expected_type(TopologicalState.parse(text)) == "0_1"


@pytest.mark.slow
def test_tied_rope_has_type_of_its_state(plan):
    assert [knot_type(shape) for shape in plan.shapes] == ["0_1", "0_1", "0_1", "+3_1"]
    assert expected_type(plan.states[-1]) == "+3_1"


@pytest.mark.slow
def test_committed_plan_has_type_of_its_state():
    text = (REPOSITORY / "results" / "overhand" / "plan.json").read_text("utf-8")
    plan = KnotPlan.from_json(text)
    assert plan.solved
    assert knot_type(plan.shapes[-1]) == expected_type(plan.states[-1]) != "0_1"


@pytest.mark.slow
def test_simulated_pentagram_with_many_crossings_has_its_type():
    points = np.loadtxt(Path(__file__).with_name("pentagram_at_rest.csv"), delimiter=",")
    assert knot_type(points) == expected_type(TopologicalState.from_curve(points)) == "+5_1"

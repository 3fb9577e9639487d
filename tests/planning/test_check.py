from pathlib import Path

import numpy as np
import pytest

from knotflow.planning import KnotMismatchError, confirm, expected_type, knot_type
from knotflow.planning.check import closed_curve
from knotflow.topology import TopologicalState, knot
from knotflow.topology.draw import draw

pytest.importorskip("topoly")

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
def test_the_sign_of_an_overhand_is_its_chirality():
    right = TopologicalState.parse("4o1+2o5+6o3+")
    assert (expected_type(right), expected_type(right.mirrored())) == ("+3_1", "-3_1")


def test_the_closure_runs_above_everything():
    points = draw(TopologicalState.parse("1o3+4o2+"))
    closed = closed_curve(points)
    np.testing.assert_array_equal(closed[0], closed[-1])
    np.testing.assert_array_equal(closed[: len(points)], points)
    assert closed[len(points) : -1, 2].min() > points[:, 2].max() + 0.05


def test_untied_states_are_unknots_even_with_an_end_inside():
    for text in ("2o1+", "1o4+3o2-", "1o3+4o2+"):
        assert expected_type(TopologicalState.parse(text)) == "0_1"


@pytest.mark.slow
def test_a_tied_rope_is_confirmed_and_another_refused(plan):
    assert confirm(plan.shapes[-1], plan.states[-1]) == "+3_1"
    assert knot_type(plan.shapes[0]) == "0_1"
    with pytest.raises(KnotMismatchError, match="is a 0_1"):
        confirm(plan.shapes[1], plan.states[-1])
    with pytest.raises(KnotMismatchError, match="is a -3_1"):
        confirm(plan.shapes[-1], plan.states[-1].mirrored())


def test_a_rope_with_many_crossings_in_projection_is_told():
    """A simulated pentagram, of which topoly would say "TMC" with its own limit of crossings."""
    points = np.loadtxt(Path(__file__).with_name("pentagram_at_rest.csv"), delimiter=",")
    assert confirm(points, TopologicalState.from_curve(points)) == "+5_1"

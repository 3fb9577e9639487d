"""Drawings on the table become ropes at rest."""

import numpy as np
import pytest

from knotflow.apps.studio.drawn import lay_drawn
from knotflow.planning import RopeInputError
from knotflow.simulation import RopeConfig, check_points
from knotflow.topology import R1, TopologicalState

ROPE = RopeConfig()
LOOP = np.array([[-0.4, 0], [0.2, 0], [0.2, 0.3], [-0.1, 0.3], [-0.1, -0.3]])


def test_a_line_is_a_rope_of_full_length_about_the_origin():
    points = lay_drawn([[0.0, 0.0], [0.3, 0.3]], ROPE)
    check_points(points, ROPE)
    assert TopologicalState.from_curve(points) == TopologicalState.trivial()
    assert points[0, :2] == pytest.approx(-points[-1, :2], abs=1e-3)


def test_a_loop_to_the_left_has_the_later_strand_on_top():
    points = lay_drawn(LOOP, ROPE)
    check_points(points, ROPE)
    assert TopologicalState.from_curve(points) == TopologicalState.trivial().apply(R1(0, 1, 1))


def test_a_mirrored_drawing_gives_the_rope_that_crosses_the_other_way():
    points = lay_drawn(LOOP * (1, -1), ROPE)
    state = TopologicalState.from_curve(points)
    assert state.crossings == ((2, 1, -1),)


@pytest.mark.parametrize(
    ("clicked", "message"),
    [
        (np.zeros((0, 2)), "at least two points"),
        ([[0, 0]], "at least two points"),
        ([[0, 0], [0.01, 0]], "the drawing is 0.01 m long"),
        ([[0, 0], [0.3, 0], [0.0, 0.002]], "bends|crossings|apart"),
    ],
)
def test_what_is_no_rope_is_refused(clicked, message):
    with pytest.raises(RopeInputError, match=message):
        lay_drawn(clicked, ROPE)

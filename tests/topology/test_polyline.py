"""Lengths along polylines."""

import numpy as np

from knotflow.topology.polyline import arc_lengths


def test_arc_lengths_begin_at_zero_even_of_a_single_point():
    assert arc_lengths(np.zeros((1, 2))).tolist() == [0.0]
    assert arc_lengths(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])).tolist() == [0.0, 5.0, 6.0]
    assert arc_lengths(np.zeros((2, 5, 3))).shape == (2, 5)

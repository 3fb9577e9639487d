"""The planar map against Euler's formula and by hand."""

from __future__ import annotations

from knotflow.topology import TopologicalState
from knotflow.topology.planar_map import LEFT, RIGHT, trace_faces


def test_faces_partition_sides_and_satisfy_euler(states_by_crossings):
    for states in states_by_crossings:
        for state in states:
            planar_map = state.planar_map
            sides = [side for face in planar_map.faces for side in face]
            assert sorted(sides) == sorted(
                (segment, side) for segment in range(state.num_segments) for side in (LEFT, RIGHT)
            )
            assert len(planar_map.faces) == state.num_crossings + 1
            for face, walk in enumerate(planar_map.faces):
                assert all(planar_map.face(*side) == face for side in walk)


def test_end_segments_border_one_face(states_by_crossings):
    for state in states_by_crossings[3]:
        planar_map = state.planar_map
        assert planar_map.left[0] == planar_map.right[0]
        assert planar_map.left[planar_map.tail] == planar_map.right[planar_map.tail]


def test_counter_clockwise_loop_encloses_a_face():
    planar_map = TopologicalState.from_crossings([(2, 1, 1)]).planar_map
    assert planar_map.segments_around(planar_map.left[1]) == (1,)
    assert planar_map.segments_around(planar_map.right[1]) == (0, 1, 2)
    assert planar_map.sides_towards(1, planar_map.left[0]) == (RIGHT,)
    assert planar_map.sides_towards(2, planar_map.left[0]) == (LEFT, RIGHT)


def test_undrawable_crossings_have_too_few_faces():
    # The Gauss word 1 2 1 2 closes no plane curve.
    assert len(trace_faces([(1, 3, 1), (2, 4, 1)]).faces) < 3

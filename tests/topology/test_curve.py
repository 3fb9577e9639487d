"""Reading states off rope shapes: by hand, under motions, and where it must be refused."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.topology import (
    DegenerateCurveError,
    TopologicalState,
    knot,
    project,
    segment_intervals,
    segment_lengths,
)
from knotflow.topology.draw import draw
from knotflow.topology.polyline import arc_lengths


def rope(*vertices):
    return np.array(vertices, dtype=float)


# Goes east, turns left and comes back south over its beginning.
LOOP = rope((0, 0, 0), (2, 0, 0), (1, 1, 0.2), (1, -1, 0.2))


def test_counter_clockwise_loop():
    crossings = project(LOOP)
    assert crossings.crossings == ((2, 1, 1),)
    np.testing.assert_allclose(crossings.xy, [[1, 0], [1, 0]])
    np.testing.assert_allclose(crossings.heights, [0.0, 0.2])
    third = np.sqrt(2.04)
    length = 2 + third + 2
    np.testing.assert_allclose(crossings.fractions, [1 / length, (2 + third + 1) / length])


def test_segment_intervals_tile_the_rope():
    state = min(knot("pentagram"))
    points = draw(state)
    intervals = segment_intervals(points)
    assert intervals.shape == (state.num_segments, 2)
    assert intervals[0, 0] == 0.0
    assert intervals[-1, 1] == 1.0
    np.testing.assert_array_equal(intervals[1:, 0], intervals[:-1, 1])
    assert (segment_lengths(points) > 0).all()
    assert segment_lengths(points).sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(segment_intervals([(0, 0, 0), (1, 0, 0)]), [[0, 1]])


def test_passages_of_a_crossing_share_their_xy():
    crossings = project(draw(min(knot("figure_eight"))))
    for over, under, _ in crossings.crossings:
        np.testing.assert_allclose(crossings.xy[over - 1], crossings.xy[under - 1], atol=1e-12)
        assert crossings.heights[over - 1] > crossings.heights[under - 1]


def test_fractions_use_length_in_space():
    steep = LOOP + [[0, 0, 5], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    crossings = project(steep)
    length = np.linalg.norm(np.diff(steep, axis=0), axis=1)
    assert crossings.fractions[1] == pytest.approx(1 - length[-1] / 2 / length.sum())


def test_state_is_invariant_under_similarity():
    points = draw(min(knot("three_twist")))
    state = TopologicalState.from_curve(points)
    for angle in np.linspace(0, 6, 13):
        c, s = np.cos(angle), np.sin(angle)
        turned = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [5.0, -300.0, 1.0]
        assert TopologicalState.from_curve(turned) == state
        assert TopologicalState.from_curve(3 * turned) == state


def test_trefoil_of_41_points():
    angle = np.pi / 3 + np.linspace(0.15, 2 * np.pi - 0.15, 41)  # cut at an outer lobe
    trefoil = 0.05 * np.stack(
        (
            np.sin(angle) + 2 * np.sin(2 * angle),
            np.cos(angle) - 2 * np.cos(2 * angle),
            -0.16 * np.sin(3 * angle),
        ),
        axis=1,
    )
    state = TopologicalState.from_curve(trefoil)
    assert state in knot("overhand")
    assert segment_lengths(trefoil).min() > 0.05


def test_neighbouring_links_do_not_cross():
    zigzag = rope((0, 0, 0), (1, 0.01, 0), (0, 0.02, 0), (1, 0.03, 0))
    assert project(zigzag).crossings == ()
    assert project(rope((0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 0, 0))).crossings == ()


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(rope((0, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 0.5), (1, -1, 1)), id="vertex"),
        pytest.param(
            rope((0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 0.5), (1, -1, 1)),
            id="vertex on vertex",
        ),
        pytest.param(rope((0, 0, 0), (2, 0, 0), (2, 0, 1), (1, 1, 0), (1, -1, 1)), id="upright"),
        pytest.param(
            rope((0, 0, 1), (0, 0, 0), (2, 0, 0), (1, 1, 0), (1, -1, 1), (1, -1, 3)),
            id="upright ends",
        ),
        pytest.param(
            rope((0, 0, 0), (2, 0, 0), (2, 0, 0), (2, 0, 0), (1, 1, 0.2), (1, -1, 0.2)),
            id="repeated vertices",
        ),
    ],
)
def test_harmless_degeneracy_is_resolved(points):
    crossings = project(points)
    assert crossings.crossings == ((2, 1, 1),)
    np.testing.assert_allclose(crossings.xy, [[1, 0], [1, 0]], atol=1e-5)  # hardly moved
    # Read from its other end, the rope is perturbed otherwise; the crossing is the same.
    back = project(points[::-1])
    reversed_state = TopologicalState.from_crossings(crossings.crossings).reversed()
    assert back.crossings == reversed_state.crossings
    np.testing.assert_allclose(back.fractions, 1 - crossings.fractions[::-1], atol=1e-5)


@pytest.mark.parametrize(
    ("points", "wrong"),
    [
        pytest.param(
            rope((0, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 0.5), (0.5, 1, 1)),
            "vertex 3 lies on link 0",
            id="touching vertex",
        ),
        pytest.param(
            rope((0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 0.5), (0.5, 1, 1)),
            "vertex 4 lies on link 0",
            id="touching vertices",
        ),
        pytest.param(
            rope((0, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 0.5)), "tail lies on link 0", id="tail"
        ),
        pytest.param(
            rope((1, 0, 0.5), (1, 1, 0), (2, 0, 0), (0, 0, 0)), "head lies on link 2", id="head"
        ),
        pytest.param(
            rope((0, 0, 0), (3, 0, 0), (3, 1, 0), (2, 1, 1), (2, 0, 1), (1, 0, 1), (1, -1, 1)),
            "lies on link",
            id="strands on top of each other",
        ),
        pytest.param(
            rope((-2, 0, 0), (2, 0, 0), (3, 3, 0), (0, 3, 1), (0, -2, 1), (-2, -2, 2), (2, 2, 2)),
            "three strands cross in one point",
            id="triple point",
        ),
        pytest.param(
            rope((0, 0, 0), (2, 0, 0), (1, 1, -1), (1, 0, -1), (1, 0, 1), (1, -1, 1)),
            "link 3 is upright",
            id="upright through a strand",
        ),
        pytest.param(
            rope((0, 0, 0), (2, 0, 0), (1, 1, 5e-4), (1, -1, 5e-4)),
            "links 0 and 2 cross 0.5 mm apart",
            id="strands through each other",
        ),
        pytest.param(np.zeros((4, 3)), "one point", id="a point"),
    ],
)
def test_harmful_degeneracy_is_refused(points, wrong):
    with pytest.raises(DegenerateCurveError, match=wrong):
        project(points)


@pytest.mark.parametrize("length", [0.05, 0.1, 0.4, 2.0])
def test_short_ropes_have_a_smaller_gap(length):
    overhand = TopologicalState.parse("4o1+2o5+6o3+")
    curve = draw(overhand, gap=0.004)
    curve *= length / arc_lengths(curve)[-1]
    assert TopologicalState.from_curve(curve) == overhand


def test_min_gap_is_a_choice():
    close = rope((0, 0, 0), (2, 0, 0), (1, 1, 5e-4), (1, -1, 5e-4))
    assert project(close, min_gap=1e-4).crossings == ((2, 1, 1),)
    with pytest.raises(DegenerateCurveError, match="min_gap = 300 mm"):
        project(LOOP, min_gap=0.3)


@pytest.mark.parametrize(
    ("points", "wrong"),
    [
        (np.zeros((5, 2)), "got shape \\(5, 2\\)"),
        (np.zeros((1, 3)), "got shape \\(1, 3\\)"),
        (np.zeros((2, 5, 3)), "got shape"),
        (rope((0, 0, 0), (np.nan, 0, 0)), "vertex 1 is not finite"),
        (rope((0, 0, 0), (1, 0, 0), (0, np.inf, 0)), "vertex 2 is not finite"),
    ],
)
def test_invalid_points_are_rejected(points, wrong):
    with pytest.raises(ValueError, match=wrong):
        TopologicalState.from_curve(points)


def test_crossings_match_brute_force():
    generator = np.random.default_rng(5)
    for _ in range(30):
        points = generator.uniform(-1, 1, (7, 3)) * [1, 1, 50]
        assert project(points).crossings == brute_force_crossings(points)


def brute_force_crossings(points):
    """Crossings by solving one 2 x 2 system for each pair of links."""
    met = []
    for i in range(len(points) - 1):
        for j in range(i + 2, len(points) - 1):
            u, v = points[i + 1] - points[i], points[j + 1] - points[j]
            matrix = np.array([u[:2], -v[:2]]).T
            s, t = np.linalg.solve(matrix, (points[j] - points[i])[:2])
            if 0 < s < 1 and 0 < t < 1:
                above = (points[i] + s * u)[2] > (points[j] + t * v)[2]
                turn = int(np.sign(u[0] * v[1] - u[1] * v[0]))
                pair = ((i + s, j + t), turn) if above else ((j + t, i + s), -turn)
                met.append(pair)
    places = sorted(place for pair, _ in met for place in pair)
    rank = {place: number for number, place in enumerate(places, start=1)}
    return tuple(
        sorted(((rank[o], rank[u], sign) for (o, u), sign in met), key=lambda c: min(c[:2]))
    )

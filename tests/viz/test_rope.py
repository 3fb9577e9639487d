"""A rope is drawn at its true thickness, with gaps in lower strands and nowhere else."""

import itertools

import numpy as np
import pytest
from matplotlib.path import Path

from knotflow.topology import knot
from knotflow.topology.draw import draw
from knotflow.viz.rope import GAP, rope_pieces
from knotflow.viz.style import PAPER, rope_colour

WIDTH = 0.016
STRAIGHT = np.column_stack((np.linspace(0, 1, 41), np.zeros(41), np.zeros(41)))


def alpha(angle=np.pi / 2, height=WIDTH):
    """A rope along x, a wide loop, and its tail across the origin at an angle and a height."""
    along = np.array([np.cos(angle), np.sin(angle)])
    corners = np.array([[-0.3, 0], [0.4, 0], [0.4, 0.4], 0.4 * along, -0.3 * along])
    flat = np.concatenate(
        [np.linspace(a, b, 40, endpoint=False) for a, b in itertools.pairwise(corners)]
    )
    z = np.zeros(len(flat))
    z[120:] = height
    return np.column_stack((flat, z))


def shown(points, places, width=WIDTH):
    """Whether each of places (N, 2) is covered by what is drawn."""
    pieces = rope_pieces(points, width)
    places = places + 1e-6 * np.array([1.0, 0.7])  # off the seams between pieces
    return np.any([Path(piece.outline).contains_points(places) for piece in pieces], axis=0)


def line(begin, end, count=2001):
    return np.linspace(begin, end, count)


def test_rope_has_true_thickness_and_end_colours():
    across = line((0.5, -0.05), (0.5, 0.05))
    assert shown(STRAIGHT, across).mean() * 0.1 == pytest.approx(WIDTH, rel=0.02)
    assert shown(STRAIGHT, line((0, 0), (1, 0))).all()
    colours = [piece.colour for piece in rope_pieces(STRAIGHT, WIDTH)]
    assert {rope_colour(0.0), rope_colour(1.0), PAPER} <= set(colours)


def test_colours_run_from_blue_to_orange():
    for along, strongest in ((0.0, 2), (1.0, 0)):
        colour = rope_colour(along)
        parts = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        assert int(np.argmax(parts)) == strongest


@pytest.mark.parametrize("angle", [90, 60, 40])
@pytest.mark.parametrize("above", [1, -1])
def test_lower_strand_has_gaps_beside_upper_strand(angle, above):
    angle = np.radians(angle)
    points = alpha(angle, above * WIDTH)
    along = np.array([np.cos(angle), np.sin(angle)])
    strands = {1: line((-0.1, 0), (0.1, 0)), -1: line(-0.1 * along, 0.1 * along)}
    upper, lower = shown(points, strands[-above]), shown(points, strands[above])
    assert upper.all()
    # On the lower strand's centre line: half the rope, then nothing, at this angle.
    free = (~lower).mean() * 0.2
    assert free == pytest.approx(2 * GAP * WIDTH / np.sin(angle), rel=0.2)


def test_gap_follows_slanted_upper_strand():
    """Each edge of the lower strand ends at the same distance from the upper one."""
    angle = np.radians(50)
    points = alpha(angle)
    normal = np.array([-np.sin(angle), np.cos(angle)])
    for side in (-0.4, 0.0, 0.4):
        edge = line((-0.1, side * WIDTH), (0.1, side * WIDTH))
        hidden = edge[~shown(points, edge)]
        distance = np.abs(hidden @ normal) / WIDTH
        assert distance.min() == pytest.approx(0.5, abs=0.08)
        assert distance.max() == pytest.approx(0.5 + GAP, abs=0.12)


def gaps(points, width):
    """How often the drawn rope is interrupted along its centre line."""
    inner = np.arange(len(points) - 1)[:, None] + np.linspace(0, 1, 20, endpoint=False)
    vertices = np.arange(len(points))
    places = [np.interp(inner.ravel(), vertices, points[:, axis]) for axis in (0, 1)]
    covered = shown(points, np.column_stack(places), width)
    return int(np.sum(np.diff(covered.astype(int)) == -1))


@pytest.mark.parametrize("name", ["overhand", "figure_eight", "pentagram"])
def test_knots_have_two_gaps_a_crossing(name):
    state = min(knot(name))
    points = draw(state)
    assert gaps(STRAIGHT, 0.008) == 0
    assert gaps(points, 0.008) == 2 * state.num_crossings


def test_pieces_are_sorted_by_height_with_head_ring_last():
    pieces = rope_pieces(draw(min(knot("overhand"))), 0.008)
    heights = [piece.height for piece in pieces[:-2]]
    assert heights == sorted(heights)
    assert [piece.colour for piece in pieces[-2:]] == [rope_colour(0.0), PAPER]


def test_degenerate_rope_is_drawn_without_gaps():
    there = np.linspace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 20)
    folded = np.concatenate((there, there[-2::-1]))  # back along itself
    assert shown(folded, line((0, 0), (0.99, 0))).all()

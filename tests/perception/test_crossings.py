"""Evidence of crossings is gathered from image to image; ends near strands are ambiguous."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.perception.estimation.crossings import (
    CrossingMemory,
    ambiguous_ends,
    crossing_fractions,
    exchange_heights,
)
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.topology import TopologicalState

from .shapes import ROPE, loop, target

CONFIG = FitConfig(softness=(3e-3, 3e-3))


def blind(points):
    """An image without depth."""
    seen = target(points)
    return replace(seen, depth=seen.depth * np.nan)


def update(memory, shape, seen):
    return memory.update(shape, seen, CONFIG)


def test_certainty_grows_from_image_to_image():
    points, memory = loop(1), CrossingMemory()
    _, (first,) = update(memory, points, target(points))
    _, (second,) = update(memory, points, target(points))
    assert 0.5 < first.certainty < second.certainty < 1
    assert not first.first_over and first.gap > ROPE.radius


def test_crossing_without_depth_is_uncertain():
    points = loop(1)
    _, (crossing,) = update(CrossingMemory(), points, blind(points))
    assert crossing.certainty < 0.95


def test_memory_corrects_exchanged_strands():
    points, memory = loop(1), CrossingMemory()
    for _ in range(3):
        _, crossings = update(memory, points, target(points))
    flipped = exchange_heights(points, *crossing_fractions(points)[0], ROPE)
    assert TopologicalState.from_curve(flipped) != TopologicalState.from_curve(points)
    shape, (crossing,) = update(memory, flipped, blind(points))
    assert TopologicalState.from_curve(shape) == TopologicalState.from_curve(points)
    assert not crossing.first_over
    again, (kept,) = update(CrossingMemory.of(crossings), flipped, blind(points))
    assert TopologicalState.from_curve(again) == TopologicalState.from_curve(points)
    assert not kept.first_over


@pytest.mark.parametrize("over", [1, -1])
def test_memory_of_known_shape_determines_crossing(over):
    points = loop(over)
    flipped = exchange_heights(points, *crossing_fractions(points)[0], ROPE)
    shape, (crossing,) = update(CrossingMemory.of_shape(points), flipped, blind(points))
    assert TopologicalState.from_curve(shape) == TopologicalState.from_curve(points)
    assert crossing.first_over == (over == -1) and crossing.certainty > 0.99


def test_crossing_evidence_reversed():
    _, (one,) = update(CrossingMemory(), loop(1), target(loop(1)))
    turned = one.reversed()
    assert turned.fractions == (1 - one.fractions[1], 1 - one.fractions[0])
    assert turned.first_over != one.first_over
    assert turned.reversed().fractions == pytest.approx(one.fractions)


def ending_at(beyond):
    """A rope whose tail ends so far beyond a strand of its own, metres."""
    corners = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.2 - beyond / 2], [0.2, 0.2 - beyond / 2]])
    corners = np.vstack([corners, [0.2, -beyond]])
    at = np.insert(np.linalg.norm(np.diff(corners, axis=0), axis=1).cumsum(), 0, 0.0)
    along = np.linspace(0, at[-1], ROPE.num_vertices)
    flat = np.stack([np.interp(along, at, one) for one in corners.T], axis=1)
    return np.column_stack([flat, np.full(len(flat), ROPE.radius)])


@pytest.mark.parametrize(
    ("beyond", "doubted"), [(0.03, False), (0.006, True), (-0.006, True), (-0.03, False)]
)
def test_end_near_a_strand_is_ambiguous(beyond, doubted):
    points = ending_at(beyond)
    assert ambiguous_ends(points, ROPE) == ((-1,) if doubted else ())
    assert ambiguous_ends(points[::-1], ROPE) == ((0,) if doubted else ())


def test_tight_bend_is_not_an_ambiguous_end():
    tight = np.arange(ROPE.num_vertices) * ROPE.max_bend  # a helix as tight as joints allow
    radius = ROPE.link_length / (2 * np.sin(ROPE.max_bend / 2))
    helix = np.stack([radius * np.cos(tight), radius * np.sin(tight), 0.01 * tight], axis=1)
    assert ambiguous_ends(helix[:4], ROPE) == ()
    assert ambiguous_ends(helix, ROPE) == (0, -1)

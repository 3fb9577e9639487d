"""What is said to be in doubt."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.perception.estimation.ambiguity import ambiguous_ends, list_ambiguities
from knotflow.perception.estimation.crossings import CrossingEvidence
from knotflow.topology import TopologicalState

from .shapes import ROPE, s_curve, target


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
def test_an_end_at_another_strand_is_in_doubt_until_it_is_clear_of_it(beyond, doubted):
    points = ending_at(beyond)
    assert ambiguous_ends(points, ROPE) == ((-1,) if doubted else ())
    assert ambiguous_ends(points[::-1], ROPE) == ((0,) if doubted else ())


def test_an_end_is_no_other_strand_of_its_own():
    tight = np.arange(ROPE.num_vertices) * ROPE.max_bend  # a helix as tight as joints allow
    radius = ROPE.link_length / (2 * np.sin(ROPE.max_bend / 2))
    helix = np.stack([radius * np.cos(tight), radius * np.sin(tight), 0.01 * tight], axis=1)
    assert ambiguous_ends(helix[:4], ROPE) == ()
    assert ambiguous_ends(helix, ROPE) == (0, -1)


def test_doubts_are_listed_in_words():
    seen, state, limits = target(s_curve()), TopologicalState.trivial(), (0.95, 0.98)
    sure, unsure = (CrossingEvidence((0.2, 0.7), True, 0.016, share) for share in (0.99, 0.7))
    assert list_ambiguities(state, (sure,), 1.0, seen, *limits) == []
    assert list_ambiguities(state, (sure, unsure), 0.5, seen, *limits) == [
        "the shape accounts for 50% of the rope in the image",
        "crossing 2 is this way round with 70% certainty",
    ]
    (unread,) = list_ambiguities(None, (), 1.0, seen, *limits)
    assert unread == "the shape's projection does not determine its state"
    gone = target(s_curve() + [0.75, 0, 0])
    assert gone.leaves_image and not seen.leaves_image
    assert list_ambiguities(None, (), 1.0, gone, *limits) == ["the rope leaves the image"]

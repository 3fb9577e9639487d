"""What is ambiguous about an estimate: ends, crossings, head."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.perception import Appearance, CameraNoiseConfig, SimulatedCamera
from knotflow.perception.estimation.ambiguity import (
    ambiguous_ends,
    find_head,
    head_contrast,
    is_head_inside,
    list_ambiguities,
)
from knotflow.perception.estimation.crossings import CrossingEvidence
from knotflow.perception.estimation.segmentation import segment
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, s_curve, target


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


def test_list_ambiguities():
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


LEAST = 0.15


@pytest.fixture(scope="module")
def contrasts():
    """Contrasts along shapes in an image of a rope, whose head is coloured unless said."""
    noise = CameraNoiseConfig(level=0.0)

    def seen(shape, head=(0.8, 0.1, 0.1)):
        eye = SimulatedCamera(CAMERA, ROPE, noise, Appearance(head=head))
        image = eye.view(s_curve()).image
        return head_contrast(shape, segment(image, CAMERA, ROPE.radius).rope, image, CAMERA)

    return seen


def test_find_head_by_colour(contrasts):
    assert find_head(contrasts(s_curve()), LEAST) == 0
    assert find_head(contrasts(s_curve()[::-1]), LEAST) == -1
    assert find_head(contrasts(s_curve(), head=None), LEAST) is None


def test_is_head_inside(contrasts):
    assert not is_head_inside(contrasts(s_curve()), LEAST)
    assert not is_head_inside(contrasts(s_curve(), head=None), LEAST)
    begun_late = np.roll(s_curve(), 10, axis=0)
    assert is_head_inside(contrasts(begun_late), LEAST)
    assert find_head(contrasts(begun_late), LEAST) is None

"""A coloured head is seen at an end, or it is not the end's."""

import numpy as np
import pytest

from knotflow.perception import Appearance, CameraNoiseConfig, SimulatedCamera
from knotflow.perception.estimation.ambiguity import find_head, head_contrast, is_head_inside
from knotflow.perception.estimation.segmentation import segment

from .shapes import CAMERA, ROPE, s_curve

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


def test_the_head_is_at_the_end_where_it_is_seen(contrasts):
    assert find_head(contrasts(s_curve()), LEAST) == 0
    assert find_head(contrasts(s_curve()[::-1]), LEAST) == -1
    assert find_head(contrasts(s_curve(), head=None), LEAST) is None


def test_a_head_along_the_rope_is_away_from_its_ends(contrasts):
    assert not is_head_inside(contrasts(s_curve()), LEAST)
    assert not is_head_inside(contrasts(s_curve(), head=None), LEAST)
    begun_late = np.roll(s_curve(), 10, axis=0)
    assert is_head_inside(contrasts(begun_late), LEAST)
    assert find_head(contrasts(begun_late), LEAST) is None

"""Independent pixels of an image, and heads by their colour."""

import numpy as np
import pytest

from knotflow.perception import Appearance, Camera, CameraNoiseConfig, SimulatedCamera, observe
from knotflow.perception.estimation.evidence import find_head, head_contrast, is_head_inside

from .shapes import CAMERA, ROPE, s_curve


def eye(camera):
    return SimulatedCamera(camera, ROPE, CameraNoiseConfig(), Appearance())


def test_independent_pixels_do_not_depend_on_resolution():
    coarse, fine = (
        observe(eye(camera).view(s_curve()).image, camera, ROPE)
        for camera in (Camera.overhead(320, 240), Camera.overhead(640, 480))
    )
    assert fine.mask.sum() > 3 * coarse.mask.sum()
    assert fine.independent_pixels == pytest.approx(coarse.independent_pixels, rel=0.15)
    assert coarse.required_coverage(0.98) == pytest.approx(0.98, abs=1e-3)
    assert fine.required_coverage(0.98) == pytest.approx(0.99, abs=1e-3)
    assert fine.required_coverage(1.0) == 1.0
    assert fine.binned(2).independent_pixels == pytest.approx(fine.independent_pixels, rel=0.15)


LEAST = 0.15


@pytest.fixture(scope="module")
def contrasts():
    """Contrasts along shapes in an image of a rope, whose head is coloured unless said."""
    noise = CameraNoiseConfig(level=0.0)

    def seen(shape, head=(0.8, 0.1, 0.1)):
        eye = SimulatedCamera(CAMERA, ROPE, noise, Appearance(head=head))
        image = eye.view(s_curve()).image
        return head_contrast(shape, observe(image, CAMERA, ROPE), image)

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

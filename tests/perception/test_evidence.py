"""What an image says counts by what it shows of the rope, not by its pixels."""

import pytest

from knotflow.perception import Appearance, Camera, CameraNoiseConfig, SimulatedCamera, observe

from .shapes import ROPE, s_curve


def eye(camera):
    return SimulatedCamera(camera, ROPE, CameraNoiseConfig(), Appearance())


def test_independent_pixels_do_not_depend_on_resolution():
    coarse, fine = (
        observe(eye(camera).view(s_curve()).image, camera, ROPE)
        for camera in (Camera.overhead(320, 240), Camera.overhead(640, 480))
    )
    assert fine.rope.sum() > 3 * coarse.rope.sum()
    assert fine.independent_pixels == pytest.approx(coarse.independent_pixels, rel=0.15)
    assert coarse.required_coverage(0.98) == pytest.approx(0.98, abs=1e-3)
    assert fine.required_coverage(0.98) == pytest.approx(0.99, abs=1e-3)
    assert fine.required_coverage(1.0) == 1.0
    assert fine.binned(2).independent_pixels == pytest.approx(fine.independent_pixels, rel=0.15)

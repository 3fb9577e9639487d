"""The spread is small where the image holds the rope, and larger where it says nothing."""

from dataclasses import replace

import pytest
import torch

from knotflow.perception.uncertainty import spread

from .shapes import CAMERA, ROPE, s_curve, target


@pytest.mark.slow
def test_a_hidden_half_is_less_certain():
    points = s_curve()
    whole = target(points)
    hidden = torch.zeros_like(whole.known)
    hidden[:, CAMERA.width // 2 :] = True
    half = replace(whole, rope=whole.rope & ~hidden, known=~hidden)
    seen, unseen = spread(points, whole, CAMERA, ROPE), spread(points, half, CAMERA, ROPE)
    assert seen.max() < ROPE.radius
    assert unseen[-5:].mean() > 2 * seen[-5:].mean()
    assert unseen[-5:].mean() > 1.5 * unseen[:10].mean()

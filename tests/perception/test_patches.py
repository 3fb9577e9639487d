"""Patches around ropes."""

import numpy as np
import pytest

from knotflow.perception.camera.image import Label
from knotflow.perception.estimation.segmentation import Segmentation
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.patches import Patch, crop_rope, project_to_plane

from .shapes import CAMERA, ROPE, loop, s_curve, seen_exactly

SIZE = 48


def exact(points: np.ndarray) -> tuple[Segmentation, np.ndarray]:
    """A perfect segmentation of a rope's image, and the rope's share of each pixel."""
    depth, mask = seen_exactly(points)
    labels = np.where(mask, Label.ROPE, Label.TABLE).astype(np.uint8)
    return Segmentation(labels, (CAMERA.position[2] - depth).astype(np.float32)), mask.astype(float)


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def mirror_images(crop: np.ndarray) -> list[np.ndarray]:
    return [crop[:, ::down, ::right] for down in (1, -1) for right in (1, -1)]


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_to_world_inverts_from_world(points):
    patch, _ = crop_rope(*exact(points), CAMERA, ROPE, SIZE)
    nodes = patch.from_world(points, CAMERA)
    assert np.abs(nodes[:, :2]).max() < 1
    assert nodes[:, 2] == pytest.approx(points[:, 2] / ROPE.radius)
    assert patch.to_world(nodes, CAMERA) == pytest.approx(points, abs=1e-12)


def test_raised_vertex_is_on_its_ray():
    raised = np.array([[0.3, -0.2, 0.1]])
    place = project_to_plane(raised, CAMERA.position, ROPE.radius)
    both = CAMERA.project([raised[0], [*place[0], ROPE.radius]])
    assert both[0, :2] == pytest.approx(both[1, :2])


@pytest.mark.parametrize("angle", [0.5, 2.0, np.pi])
def test_patch_rotates_with_rope(angle):
    places = s_curve()[:, :2]
    one = Patch.around(places, ROPE.radius, ROPE.length)
    other = Patch.around(turned(s_curve(), angle)[:, :2], ROPE.radius, ROPE.length)
    assert other.half == pytest.approx(one.half)
    assert other.centre == pytest.approx(turned(np.array([[*one.centre, 0]]), angle)[0, :2])
    axes = turned(np.column_stack([one.axes.T, [0, 0]]), angle)[:, :2].T
    assert np.abs(axes.T @ other.axes) == pytest.approx(np.eye(2), abs=1e-9)


@pytest.mark.parametrize("angle", [0.5, np.pi])
def test_crop_is_rotation_invariant(angle):
    _, crop = crop_rope(*exact(loop(1)), CAMERA, ROPE, SIZE)
    _, other = crop_rope(*exact(turned(loop(1), angle) + [0.05, -0.03, 0]), CAMERA, ROPE, SIZE)
    nearest = min(np.abs(crop - one)[0].sum() for one in mirror_images(other))
    assert nearest < 0.4 * crop[0].sum()  # pixels fall otherwise
    assert np.abs(crop - np.rot90(crop, axes=(1, 2)))[0].sum() > crop[0].sum()  # were it not so


def test_hidden_pixels_are_unknown():
    segmentation, share = exact(s_curve())
    row, column = np.argwhere(segmentation.rope)[40]
    segmentation.labels[row - 6 : row + 7, column - 6 : column + 7] = Label.GRIPPER
    _, crop = crop_rope(segmentation, share, CAMERA, ROPE, SIZE)
    assert crop[2].min() < 0.1
    assert np.median(crop[2]) > 0.9


def test_on_plane_inverts_project():
    mask = np.zeros((CAMERA.height, CAMERA.width), bool)
    mask[100, 200] = True
    (place,) = CAMERA.on_plane(mask, ROPE.radius)
    assert CAMERA.project([*place, ROPE.radius])[:2] == pytest.approx([200, 100])


def test_crop_without_rope_raises():
    segmentation, share = exact(s_curve())
    segmentation.labels[:] = Label.TABLE
    with pytest.raises(TraceError, match="no rope"):
        crop_rope(segmentation, share, CAMERA, ROPE, SIZE)

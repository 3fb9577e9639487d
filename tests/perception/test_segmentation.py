"""Segmentation and pixel coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from knotflow.perception import (
    SAMPLE,
    Appearance,
    Camera,
    CameraNoiseConfig,
    ImageError,
    Label,
    SimulatedCamera,
    add_noise,
    read_capture,
    segment,
)
from knotflow.perception.camera.simulated import TAPE
from knotflow.perception.estimation.segmentation import pixel_coverage
from knotflow.simulation import RopeConfig, straight

ROPE = RopeConfig(radius=0.008)


def iou(one, other):
    return (one & other).sum() / (one | other).sum()


def seen(camera, points, level, rng, gripper=None, look=None):
    """A noisy image and its true labels, unknown where the noise left no depth."""
    noise = CameraNoiseConfig(level=level)
    simulated = SimulatedCamera(camera, ROPE, noise, look or Appearance.draw(rng, noise))
    view = simulated.view(points, gripper)
    image = add_noise(view.image, camera, noise, rng)
    return image, np.where(np.isnan(image.depth), Label.UNKNOWN, view.labels)


@pytest.mark.parametrize(("level", "least"), [(0, 0.85), (1, 0.85), (2, 0.5)])
def test_segment_rope_and_gripper(level, least, camera, overhand, rng):
    for gripper in (None, overhand[20], overhand[30] + [0.0, 0.0, 0.1]):
        image, true = seen(camera, overhand, level, rng, gripper)
        found = segment(image, camera, ROPE.radius)
        assert iou(found.rope, true == Label.ROPE) > least
        if gripper is not None:
            assert iou(found.labels == Label.GRIPPER, true == Label.GRIPPER) > 0.7
        else:
            assert not (found.labels == Label.GRIPPER).any()


@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize("along", [0, 1], ids=["rows", "columns"])
def test_segment_rope_between_pixels(along, level, camera, rng):
    """It covers the middles of two rows, where it covers those of three elsewhere."""
    line = straight(ROPE) if along == 0 else straight(ROPE)[:, [1, 0, 2]]
    image, true = seen(camera, line, level, rng)
    assert iou(segment(image, camera, ROPE.radius).rope, true == Label.ROPE) > 0.8


def test_segment_rope_of_table_colour(camera, overhand, rng):
    look = Appearance(rope=(0.4, 0.4, 0.4), table=(0.4, 0.4, 0.4))
    image, true = seen(camera, overhand, 1, rng, look=look)
    assert iou(segment(image, camera, ROPE.radius).rope, true == Label.ROPE) > 0.5


def test_pixels_without_depth_are_unknown(camera, overhand, rng):
    image, _ = seen(camera, overhand, 1, rng)
    image.depth[60:80, 200:240] = np.nan
    found = segment(image, camera, ROPE.radius)
    assert (found.labels == Label.UNKNOWN)[np.isnan(image.depth)].all()
    assert np.isnan(found.height[60:80, 200:240]).all()


@pytest.mark.parametrize("level", [0, 1, 2])
def test_segment_bare_table(level, camera, rng):
    for _ in range(3):
        image, _ = seen(camera, straight(ROPE) + [5.0, 0.0, 0.0], level, rng)
        found = segment(image, camera, ROPE.radius)
        assert not found.rope.any() and not (found.labels == Label.GRIPPER).any()
        assert (found.labels == Label.TABLE).mean() > 0.9


def test_segment_corrects_pose_error(camera, overhand, rng):
    image, true = seen(camera, overhand, 1, rng)
    tilt = Rotation.from_euler("xy", [1.0, -1.0], degrees=True).as_matrix()
    off = replace(
        camera, rotation=tilt @ camera.rotation, position=camera.position + [0.0, 0.0, 0.008]
    )
    found = segment(image, off, ROPE.radius)
    assert iou(found.rope, true == Label.ROPE) > 0.8
    assert abs(np.median(found.height[(found.labels == Label.TABLE)])) < 2e-3


def test_the_shipped_sample_is_segmented():
    files = [SAMPLE / name for name in ("overhand.png", "overhand-depth.png", "camera.yaml")]
    image, camera = read_capture(*files).image, Camera.overhead()
    points = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    true = SimulatedCamera(camera, RopeConfig()).view(points).labels == Label.ROPE
    found = segment(image, camera, RopeConfig().radius)
    assert iou(found.rope, true & ~(found.labels == Label.UNKNOWN)) > 0.85


def test_image_of_wrong_size_raises(overhand, camera, rng):
    image, _ = seen(camera, overhand, 0, rng)
    with pytest.raises(ImageError, match="320x240 pixels, but the camera's are 640x480"):
        segment(image, Camera.overhead(640, 480), ROPE.radius)


CREAM, BLUE, GREY = (0.85, 0.80, 0.68), (0.2, 0.35, 0.6), (0.5, 0.5, 0.5)


def look(camera, points, rng, rope, table, head=TAPE):
    """Coverage and true rope (H, W), and whether that is of the rope's head."""
    simulated = SimulatedCamera(
        camera, ROPE, CameraNoiseConfig(), Appearance(rope=rope, table=table, head=head)
    )
    rows, columns = np.indices((camera.height, camera.width))
    column, row, _ = camera.project(points).T
    nearest = np.hypot(columns[..., None] - column, rows[..., None] - row).argmin(axis=-1)
    true = simulated.view(points).labels == Label.ROPE
    image = simulated.capture(points, rng)
    return pixel_coverage(image, segment(image, camera, ROPE.radius)), true, true & (nearest < 2)


def test_pixel_coverage_sums_to_area(camera, overhand, rng):
    share, true, _ = look(camera, overhand, rng, CREAM, BLUE, head=None)
    assert share.sum() == pytest.approx(true.sum(), rel=0.1)
    assert ((share > 0.2) & (share < 0.8)).sum() > 0.1 * true.sum()


@pytest.mark.parametrize(
    ("rope", "table"),
    [
        (CREAM, BLUE),
        ((0.71, 0.91, 0.67), (0.68, 0.47, 0.23)),
        ((0.66, 0.76, 0.94), (0.61, 0.32, 0.38)),
    ],
    ids=["apart from both", "beyond a brown table", "beyond a red table"],
)
def test_head_counts_as_rope(rope, table, camera, overhand, rng):
    """Seen from the rope's colour, a head of another may lie beyond the table's."""
    share, true, head = look(camera, overhand, rng, rope, table)
    assert share[head & binary_erosion(true)].mean() > 0.9


def test_pixel_coverage_without_contrast_is_binary(camera, overhand, rng):
    share, true, _ = look(camera, overhand, rng, GREY, GREY, head=None)
    assert set(np.unique(share)) == {0.0, 1.0}
    assert (share[true] == 1).mean() > 0.7

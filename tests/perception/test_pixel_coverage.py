"""Shares of pixels that are rope, against the simulator's true labels."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from knotflow.perception import (
    Appearance,
    CameraNoiseConfig,
    Label,
    SimulatedCamera,
    segment,
)
from knotflow.perception.camera.simulated import TAPE
from knotflow.perception.estimation.segmentation import pixel_coverage
from knotflow.simulation import RopeConfig

ROPE = RopeConfig()
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


def test_shares_add_up_to_the_area_of_the_rope(camera, overhand, rng):
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
def test_a_head_is_rope_on_whichever_side_of_the_table_its_colour_is(
    rope, table, camera, overhand, rng
):
    """Seen from the rope's colour, a head of another may lie beyond the table's."""
    share, true, head = look(camera, overhand, rng, rope, table)
    assert share[head & binary_erosion(true)].mean() > 0.9


def test_where_rope_and_table_look_alike_pixels_are_rope_or_not(camera, overhand, rng):
    share, true, _ = look(camera, overhand, rng, GREY, GREY, head=None)
    assert set(np.unique(share)) == {0.0, 1.0}
    assert (share[true] == 1).mean() > 0.7

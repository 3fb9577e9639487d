"""From an image's files to a rope's file; what cannot be read is named."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from knotflow.perception import (
    SAMPLE,
    Calibration,
    Camera,
    CameraError,
    ImageError,
    RgbdImage,
    read_capture,
    see,
)
from knotflow.perception.estimation.estimate import RopeEstimate
from knotflow.perception.io import arrange_pictures, describe, draw_overlay, write_rope
from knotflow.planning import read_rope
from knotflow.simulation import RopeConfig
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, image, s_curve

FILES = (SAMPLE / "overhand.png", SAMPLE / "overhand-depth.png", SAMPLE / "camera.yaml")


@pytest.fixture
def found():
    points = s_curve()
    count = len(points)
    state = TopologicalState.from_curve(points)
    seen = np.arange(count) > 3
    return RopeEstimate(points, seen, state, (), 0.99, True, ("the rope leaves the image",))


@pytest.mark.slow
def test_see_sample():
    seen, _ = see(*FILES)
    truth = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    assert seen.state == TopologicalState.from_curve(truth) and seen.head_known
    assert not seen.all_ambiguities
    assert np.linalg.norm(seen.points - truth, axis=1).mean() < 3e-3


def test_written_rope_is_a_valid_start(tmp_path, found):
    write_rope(tmp_path / "rope.csv", found.points)
    assert np.allclose(read_rope(tmp_path / "rope.csv", ROPE), found.points, atol=1e-5)


def test_describe(found):
    told = describe(found)
    assert "state     trivial (in doubt)" in told
    assert "in doubt  the rope leaves the image" in told
    hanging = describe(replace(found, ambiguities=(), ambiguous_ends=(-1,)))
    assert "state     trivial (in doubt)" in hanging
    assert "in doubt  the tail ends at another strand" in hanging


def test_draw_overlay(tmp_path, found):
    draw_overlay(tmp_path / "overlay.png", image(found.points), CAMERA, ROPE, found)
    picture = np.asarray(Image.open(tmp_path / "overlay.png").convert("RGB")).astype(int)
    half = picture.shape[1] // 2
    colourful = (np.ptp(picture, axis=2) > 80).sum(axis=0)
    assert colourful[half:].sum() > 10 * colourful[:half].sum() + 1000


@pytest.mark.parametrize("size", [(580, 220), (240, 320)])
def test_an_overlay_has_the_shape_of_its_image(tmp_path, found, size):
    camera = Camera.overhead(*size)
    shown = RgbdImage(
        np.full((size[1], size[0], 3), 90, np.uint8), np.full(size[::-1], 1.2, np.float32)
    )
    draw_overlay(tmp_path / "overlay.png", shown, camera, ROPE, found)
    picture = np.asarray(Image.open(tmp_path / "overlay.png").convert("RGB")).astype(int)
    assert picture.shape[0] / (picture.shape[1] / 2) == pytest.approx(size[1] / size[0], rel=0.3)
    grey = (np.abs(picture - 90).max(axis=2) < 9).any(axis=0)
    half = len(grey) // 2
    assert grey[:half].sum() == pytest.approx(grey[half:].sum(), rel=0.05)  # as wide as the image


def test_error_without_rope_names_files(tmp_path):
    Image.new("RGB", (320, 240), (60, 60, 60)).save(tmp_path / "bare.png")
    np.save(tmp_path / "bare.npy", np.full((240, 320), 1.2))
    with pytest.raises(ImageError, match=r"bare\.png.*no rope of 1 m by 10 mm is seen"):
        see(tmp_path / "bare.png", tmp_path / "bare.npy", FILES[2])


def test_constant_depth_raises(tmp_path):
    np.save(tmp_path / "nothing.npy", np.full((240, 320), np.nan))
    with pytest.raises(ImageError, match="no pixel has a depth"):
        see(FILES[0], tmp_path / "nothing.npy", FILES[2])


def test_incomplete_camera_file_raises(tmp_path):
    lines = FILES[2].read_text("utf-8").splitlines()
    (tmp_path / "camera.yaml").write_text("\n".join(x for x in lines if not x.startswith("fx")))
    with pytest.raises(CameraError, match="lacks fx"):
        see(*FILES[:2], tmp_path / "camera.yaml")


def test_camera_pose_off_the_table_raises(tmp_path):
    in_millimetres = tmp_path / "camera.yaml"
    camera = Calibration.load(FILES[2]).camera()
    replace(camera, position=1e3 * camera.position).save(in_millimetres)
    told = r"camera\.yaml.*\+1198\.80 m above z = 0.*divided by 1000"
    with pytest.raises(CameraError, match=told):
        see(*FILES[:2], in_millimetres)
    tilted = tmp_path / "tilted.yaml"
    turn = np.array([[1, 0, 0], [0, 0.96, -0.28], [0, 0.28, 0.96]])
    replace(camera, rotation=turn @ camera.rotation).save(tilted)
    with pytest.raises(CameraError, match="tilted by 16 degrees"):
        see(*FILES[:2], tilted)


def test_image_of_wrong_size_raises(tmp_path):
    Image.open(FILES[0]).resize((160, 90)).save(tmp_path / "small.png")
    np.save(tmp_path / "small.npy", np.full((90, 160), 1.2))
    with pytest.raises(CameraError, match="160x90"):
        see(tmp_path / "small.png", tmp_path / "small.npy", FILES[2])


def test_depth_in_an_assumed_unit_in_which_the_rope_is_huge_raises(tmp_path):
    without_pose = replace(Calibration.load(FILES[2]), poses=())
    depth = np.asarray(Image.open(FILES[1]))
    Image.fromarray((depth * 2.4).astype(np.uint16)).save(tmp_path / "depth.png")
    with pytest.raises(ImageError, match="--depth-unit 0.25mm"):
        see(FILES[0], tmp_path / "depth.png", without_pose, RopeConfig())


def test_what_was_made_of_the_files_is_said(found):
    seen = read_capture(FILES[0], FILES[1], replace(Calibration.load(FILES[2]), poses=()))
    assert describe(found, seen).startswith("input     depth is in millimetres, the usual unit")
    assert "m above it, and looks 0." in describe(found, seen)


def test_pictures_are_arranged_row_by_row(tmp_path):
    colours = {"red": (255, 0, 0), "lime": (0, 255, 0), "blue": (0, 0, 255)}
    for name, colour in colours.items():
        Image.new("RGB", (40, 20), colour).save(tmp_path / f"{name}.png")
    arrange_pictures([tmp_path / f"{name}.png" for name in colours], tmp_path / "all.png", width=60)
    with Image.open(tmp_path / "all.png") as whole:
        shown = whole.convert("RGB")
    assert shown.size == (60, 30)
    places = ((15, 7), (45, 7), (15, 22), (45, 22))
    assert [shown.getpixel(place) for place in places] == [*colours.values(), (255, 255, 255)]

"""Ropes in photographs: states of drawn ropes are read, and doubtful ones are said to be."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree
from tests.perception.photographs import centre_line, crossings_of, photograph, state_of

from knotflow.perception import Camera, ImageError
from knotflow.perception.photo import io
from knotflow.perception.photo.colours import NO_HEAD, Colours, end_of_colour
from knotflow.perception.photo.estimate import estimate_photo
from knotflow.topology import TopologicalState

SHAPE = (240, 320)
REAL = Path(__file__).parents[3] / "shared" / "real" / "images"


def drawn(name: str, seed: int, shape: tuple[int, int] = SHAPE, **style: object):
    """A picture, its centre line (N, 2) and its state."""
    line = centre_line(name, shape)
    first_over = [bool(one) for one in np.random.default_rng(seed).integers(0, 2, 3)]
    first_over = first_over[: len(crossings_of(line))]
    return photograph(line, first_over, shape, **style), line, state_of(line, first_over)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "style"),
    [
        ("overhand", {"width": 4}),
        ("pretzel", {"width": 12, "colour": (40, 60, 150), "table": (210, 200, 190)}),
        ("loop", {"colour": (220, 200, 60), "table": (60, 60, 200), "light": 0.4}),
    ],
)
def test_state_of_a_drawn_rope(name, style):
    rgb, line, state = drawn(name, 5, **style)
    found = estimate_photo(rgb)
    assert found.state in (state, state.reversed())
    assert not found.doubts
    off, _ = cKDTree(found.pixels).query(line)
    assert (off < style.get("width", 9) / 2).mean() > 0.95


@pytest.mark.slow
def test_without_shading_the_upper_strand_is_in_doubt():
    found = estimate_photo(drawn("overhand", 0, shading=0, shadow=0, noise=8)[0])
    assert len(found.crossings) == 3
    assert any("cannot be told" in one for one in found.doubts)


@pytest.mark.slow
def test_doubts_name_a_second_rope_and_ends_outside():
    rgb, *_ = drawn("arc", 0, (150, 400))
    both = np.concatenate([rgb, rgb[:, :330]], axis=1)[:, 60:]  # cut on the left
    doubts = " ".join(estimate_photo(np.concatenate([both, drawn("arc", 0, (150, 670))[0]])).doubts)
    assert "ropes are in view" in doubts
    assert "border" in " ".join(estimate_photo(rgb[:, 60:]).doubts)


@pytest.mark.slow
def test_a_colour_selects_the_rope():
    red, blue = (
        drawn("arc", 0, (150, 300), colour=one)[0] for one in ((200, 60, 60), (60, 90, 220))
    )
    both = np.concatenate([red, blue])
    given = [Colours((200, 60, 60)), Colours((60, 90, 220))]
    rows = [estimate_photo(both, one).pixels[:, 1] for one in given]
    assert rows[0].max() < 150 < rows[1].min()


def test_no_rope_is_seen():
    rng = np.random.default_rng(0)
    rgb = np.full((200, 300, 3), 60, np.uint8) + rng.integers(0, 6, (200, 300, 3), np.uint8)
    with pytest.raises(ImageError, match="no rope is seen"):
        estimate_photo(rgb)
    rgb[40:120, 60:200] = (200, 40, 40)  # a box
    rgb[140:190, 220:280] = (40, 40, 200)
    with pytest.raises(ImageError, match="no rope is seen"):
        estimate_photo(rgb)


@pytest.mark.slow
def test_a_written_rope_keeps_its_state(tmp_path):
    from knotflow.planning import RopeOptions, measured_rope
    from knotflow.seeding import rng_of

    rgb, _, state = drawn("overhand", 2, (320, 260))
    Image.fromarray(rgb).save(tmp_path / "rope.png")
    found, seen = io.see_photo(tmp_path / "rope.png")
    io.write_photo_rope(tmp_path / "rope.csv", io.on_table(found, 0.9, None), found.over)
    measured = measured_rope(str(tmp_path / "rope.csv"), RopeOptions(length="0.9m"), rng_of(0, 0))
    read = TopologicalState.from_curve(measured.points)
    assert read == found.state
    assert read in (state, state.reversed())
    with pytest.raises(ImageError, match="--length"):
        io.on_table(found, None, None)
    io.draw_photo(tmp_path / "drawn.png", seen, found)
    assert (tmp_path / "drawn.png").stat().st_size > 10_000


def test_a_turned_photograph_is_refused_with_a_camera(tmp_path):
    rgb, *_ = drawn("overhand", 2)
    turned = Image.Exif()
    turned[0x0112] = 6
    Image.fromarray(rgb).save(tmp_path / "rope.jpg", exif=turned)
    with pytest.raises(ImageError, match="EXIF"):
        io.see_photo(tmp_path / "rope.jpg", Camera.overhead(*SHAPE))


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="the photographs are not at hand")
def test_a_real_photograph():
    label = next(
        one for one in json.loads((REAL / "labels.json").read_text()) if "91" in one["file"]
    )
    found, _ = io.see_photo(REAL / label["file"])
    state = TopologicalState.parse(label["state"])
    assert found.state in (state, state.reversed())
    assert not found.doubts


@pytest.mark.slow
def test_a_camera_with_a_pose_wins_over_the_length():
    line = np.column_stack([np.linspace(60, 260, 50), np.full(50, 100.0)])
    found = SimpleNamespace(pixels=line, length=200.0)
    eye = Camera.overhead(320, 240, distance=0.8)
    xy = io.on_table(found, 3.0, eye)
    seen = eye.project(np.column_stack([xy, np.zeros(50)]))[:, :2]
    np.testing.assert_allclose(seen, line, atol=1e-6)
    level = replace(eye, rotation=eye.rotation @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    with pytest.raises(ImageError, match="above the horizon"):
        io.on_table(found, None, level)


@pytest.mark.parametrize("text", ["rgb(300,0,0)", "reddish"])
def test_what_is_no_colour_is_refused(text):
    with pytest.raises(ImageError, match="is no colour: give a name"):
        Colours.parse(text, None)


def test_a_thin_mark_of_a_dark_shade_tells_the_head():
    rgb = np.full((60, 300, 3), (250, 205, 147), np.uint8)
    rgb[:, 12:15] = (65, 59, 75)
    rgb[:, 285:288] = (190, 55, 52)
    line = np.column_stack([np.linspace(5, 295, 17), np.full(17, 30.0)])
    for name, end in (("blue", 0), ("red", -1), ("green", None), ("#f0c890", None)):
        colour = Colours.parse(head=name).head
        assert colour is not None
        assert end_of_colour(rgb, line, colour) == end
        turned = {0: -1, -1: 0, None: None}[end]
        assert end_of_colour(rgb, line[::-1], colour) == turned


def test_the_heads_colour_tells_the_head():
    rgb, line, state = drawn("overhand", 5)
    for end in (0, -1):
        marked = rgb.copy()
        v, u = np.indices(SHAPE)
        on_rope = cKDTree(line).query(np.stack([u, v], -1).reshape(-1, 2))[0].reshape(SHAPE) < 4
        marked[on_rope & (np.hypot(u - line[end, 0], v - line[end, 1]) < 12)] = (200, 30, 40)
        found = estimate_photo(marked, Colours.parse(head="crimson"))
        assert found.head_known and np.linalg.norm(found.pixels[0] - line[end]) < 9
        assert found.state == (state if end == 0 else state.reversed())
        other = estimate_photo(marked, Colours.parse(head="green"))
        assert not other.head_known and NO_HEAD in other.doubts
    assert not estimate_photo(rgb, Colours.parse(head="crimson")).head_known
    with pytest.raises(ImageError, match="no colour"):
        Colours.parse(head="reddish")

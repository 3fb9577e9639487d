"""What the tabs do without a browser."""

from types import SimpleNamespace

import numpy as np
import pytest

from knotflow.apps.studio.session import Session

pytest.importorskip("viser", reason="the studio needs: pip install 'knotflow[studio]'")

from knotflow.apps.studio.page import Page
from knotflow.apps.studio.playback import Frame
from knotflow.apps.studio.tabs import RopeTab


@pytest.fixture
def state(tmp_path):
    page = Page(Session("straight", tmp_path / "mine.jsonl"), port=8491)
    yield page.state
    page.close()


def test_one_bad_file_of_an_image_is_loaded_again_alone(state, monkeypatch):
    read = []

    def lay_image(files, options):
        read.append({key: name for key, (name, _) in files.items()})
        if files["camera"][0] == "bad.yaml":
            raise ValueError("bad.yaml: cannot be read")
        return ()

    def load(key, name):
        file = SimpleNamespace(name=name, content=b"")
        tab._image(SimpleNamespace(target=SimpleNamespace(value=file)), key)

    monkeypatch.setattr(state.session, "lay_image", lay_image)
    tab = RopeTab(state)
    load("rgb", "rope.png")
    load("depth", "depth.png")
    with pytest.raises(ValueError, match=r"bad\.yaml"):
        load("camera", "bad.yaml")
    load("camera", "good.yaml")
    assert read[1] == {"rgb": "rope.png", "depth": "depth.png", "camera": "good.yaml"}
    load("rgb", "next.png")  # begins another image
    assert len(read) == 2


def test_state_above_the_tabs_is_that_before_what_is_watched(state):
    state.watch([Frame(state.session.points, np.zeros(3), np.zeros((3, 3)), "1.0 s")])
    assert state._rope_line.content.startswith("**Before:** `trivial`")
    state.unwatch()
    assert state._rope_line.content.startswith("**On the table:** `trivial`")


def test_another_rope_ends_a_drawing(state):
    tab = RopeTab(state)
    begin = tab._draw.label
    tab._start_or_finish_drawing(None)
    assert tab._draw.label == "Finish drawing"
    tab._add_corner(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]))
    state.session.lay_named("arc")
    state.rope_changed("An arc.")
    assert tab._draw.label == begin and not tab._corners

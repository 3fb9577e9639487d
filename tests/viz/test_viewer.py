import io
import re
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from knotflow.apps.cli import main
from knotflow.recording import DamagedRecordingError, messages, write_recording
from knotflow.recording.rollout import NANOSECONDS
from knotflow.viz import viewer
from knotflow.viz.viewer import (
    APPLICATION,
    TIMELINE,
    blueprint,
    find_recording,
    rerun_program,
    save_rerun,
    show,
)

TOPICS = {
    *(messages.ROPE, messages.ROPE_LINE, messages.GRIPPER, messages.SPLINE, messages.TOPOLOGY)
}
VIEWS = {"3D", "TextLog"}


@pytest.fixture
def folder(tmp_path, make_rollout):
    write_recording(tmp_path / "a.mcap", map(make_rollout, [4, 5]), {})
    write_recording(tmp_path / "b.mcap", map(make_rollout, [5, 6]), {"stage": "test"})
    return tmp_path


@pytest.fixture
def opened(monkeypatch):
    windows = []
    monkeypatch.setattr(viewer, "open_rerun", windows.append)
    return windows


@pytest.fixture
def converted(monkeypatch):
    """Recordings and numbers that Rerun files were asked of; none is written."""
    asked = []

    def save(path, target, number):
        asked.append((path.name, number))
        return Path(target)

    monkeypatch.setattr(viewer, "save_rerun", save)
    return asked


def test_number_finds_its_file(folder):
    assert find_recording(folder / "b.mcap", 99) == folder / "b.mcap"
    assert find_recording(folder) == folder / "a.mcap"
    assert find_recording(folder, 6) == folder / "b.mcap"
    with pytest.raises(ValueError, match="no rollout number 7; there are 4 rollouts from 4 to 6"):
        find_recording(folder, 7)
    with pytest.raises(ValueError, match=r"rollout 5 is in several .*a\.mcap.*b\.mcap"):
        find_recording(folder, 5)


def test_show_opens_the_recording_asked_for(folder, opened, converted, capsys):
    show(folder / "b.mcap")
    show(folder, 6)
    assert capsys.readouterr().out.count("showing b.mcap of 2 recordings: a.mcap, b.mcap") == 1
    show(folder)
    assert "showing a.mcap of 2 recordings" in capsys.readouterr().out
    assert converted == [("b.mcap", None), ("b.mcap", 6), ("a.mcap", None)]
    assert len(opened) == 3


def test_web_serves_instead_of_opening(folder, opened, converted, monkeypatch):
    served = []
    monkeypatch.setattr(viewer, "serve_rerun", served.append)
    show(folder, 6, web=True)
    assert converted == [("b.mcap", 6)] and len(served) == 1 and opened == []


def test_address_of_the_page_is_printed(folder, monkeypatch, capsys):
    def run(command, check, env):
        assert command[command.index("--web-viewer-port") + 1] == "9090"
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(viewer.subprocess, "run", run)
    viewer.serve_rerun(folder / "a.rrd")
    page = "http://localhost:9090?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9091%2Fproxy"
    assert capsys.readouterr().out.startswith(page)


@pytest.mark.slow
def test_save_writes_a_file_and_opens_nothing(folder, opened, capsys):
    pytest.importorskip("rerun")
    target = folder / "out.rrd"
    show(folder / "a.mcap", 5, save=target)
    assert target.stat().st_size > 1000 and str(target) in capsys.readouterr().out
    assert opened == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.mcap", "missing.mcap is not there"),
        ("text.mcap", "text.mcap is not an MCAP file"),
        ("notes", "there is: notes.txt"),
    ],
)
def test_command_names_bad_paths_in_one_line(tmp_path, opened, capsys, name, words):
    (tmp_path / "text.mcap").write_text("hello, this is no recording")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes/notes.txt").write_text("")
    assert main(["view", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1
    assert opened == []


def test_a_saved_file_is_not_replaced(folder, opened, capsys):
    target = folder / "out.rrd"
    target.write_text("mine")
    assert main(["view", str(folder / "a.mcap"), "--save", str(target)]) == 2
    assert "out.rrd exists already; name another file with --save" in capsys.readouterr().err
    assert target.read_text() == "mine"


def test_command_names_the_missing_viewer(folder, converted, monkeypatch, capsys):
    def fail(command, **options):
        return subprocess.CompletedProcess(command, 1, stderr="starting\nError: no screen\n")

    monkeypatch.setattr(viewer.subprocess, "run", fail)
    assert main(["view", str(folder / "a.mcap")]) == 1
    assert "no screen; without a screen, use --save or --web" in capsys.readouterr().err


def pixels_like(png: bytes, rgb: tuple[int, int, int]) -> int:
    """How many pixels have the hue of a colour, however it is lit."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float).reshape(-1, 3)
    bright = pixels[pixels.max(axis=1) > 60]
    unit = bright / np.linalg.norm(bright, axis=1, keepdims=True)
    return int((unit @ (np.array(rgb) / np.linalg.norm(rgb)) > 0.995).sum())


@pytest.fixture
def check(tmp_path, headless):
    """Opens a recording without a window: what Rerun finds wrong, the entities, and the PNG of the
    3-D view at a fraction of the recording."""
    from rerun.experimental import ViewerClient

    def run(recording, at=0.5):
        rrd = save_rerun(recording, tmp_path / "recording.rrd")
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = int(probe.getsockname()[1])
        with ViewerClient.spawn(
            headless=True, port=port, executable_path=rerun_program()
        ) as client:
            client.open(str(rrd))
            deadline = time.monotonic() + 60.0
            while True:
                state = client.get_state()
                shown = {view.view_class for view in state.views}
                if not state.loading and state.recordings and shown >= VIEWS:
                    break
                assert time.monotonic() < deadline, shown
                time.sleep(0.2)
            (line,) = [one for one in state.recordings[0].timelines if one.name == TIMELINE]
            end = (line.end or 0) / NANOSECONDS  # a recording starts at 0
            client.set_time(TIMELINE, duration=at * end, play_state="paused")
            scene = next(view for view in state.views if view.view_class == "3D")
            client.take_screenshot()  # paints everything, so that the reports are of this time
            picture = client.take_screenshot(scene.view_id)
            state = client.get_state()
            schema = client.get_recording_schema(paths_only=True)
        reports = [report for view in state.views for report in view.reports]
        problems = [f"{one.severity}: {one.summary}" for one in reports]
        problems += [f"{view.name} is not visible" for view in state.views if not view.visible]
        return problems, {entity.entity_path for entity in schema.entities}, picture

    return run


@pytest.mark.slow
def test_rerun_shows_rope_gripper_spline_and_topology(folder, check):
    problems, entities, picture = check(folder / "a.mcap", at=0.2)
    assert problems == []
    assert entities >= TOPICS
    for name in ("HEAD_RGB", "TAIL_RGB", "GRIPPER_RGB", "SPLINE_RGB", "CONTROL_RGB"):
        assert pixels_like(picture, getattr(messages, name)) > 30, name


@pytest.fixture
def recording(tmp_path, make_rollout):
    path = tmp_path / "a.mcap"
    write_recording(path, map(make_rollout, [5, 6]), {})
    return path


def test_only_the_chosen_rollout_is_saved(recording, tmp_path):
    reader = pytest.importorskip("rerun.chunk").RrdReader

    def logged(number):
        rrd = save_rerun(recording, tmp_path / "a.rrd", number=number)
        (found,) = reader(rrd).recordings()
        chunks = reader(rrd).stream(store=found).to_chunks()
        frames = [one for one in chunks if one.entity_path == "/rope/points" and not one.is_static]
        return found.recording_id, sum(one.num_rows for one in frames)

    assert logged(None) == ("a", 52) and logged(6) == ("a#6", 26)
    with pytest.raises(ValueError, match="no rollout number 9; there are 2 rollouts from 5 to 6"):
        save_rerun(recording, tmp_path / "a.rrd", number=9)


def test_recording_is_not_written_over(recording):
    before = recording.read_bytes()
    with pytest.raises(ValueError, match=r"a\.mcap: a Rerun file ends in \.rrd"):
        save_rerun(recording, recording)
    assert recording.read_bytes() == before


def test_a_rerun_file_that_cannot_be_made_is_named(tmp_path, make_rollout):
    pytest.importorskip("rerun")
    write_recording(tmp_path / "a.mcap", map(make_rollout, range(1)), {})
    (tmp_path / "a.rrd").mkdir()
    with pytest.raises(OSError, match=r"a\.rrd"):
        save_rerun(tmp_path / "a.mcap", tmp_path / "a.rrd")


def test_damaged_recording_is_not_converted(tmp_path, make_rollout):
    path = tmp_path / "changed.mcap"
    write_recording(path, map(make_rollout, range(30)), {})
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 255
    path.write_bytes(whole)
    with pytest.raises(DamagedRecordingError, match="is damaged"):
        save_rerun(path, tmp_path / "out.rrd")
    assert not (tmp_path / "out.rrd").exists()


@pytest.mark.slow
def test_saved_file_holds_recording_and_blueprint(recording, tmp_path):
    pytest.importorskip("rerun")
    rrd = save_rerun(recording, tmp_path / "a.rrd", number=6)
    command = [rerun_program(), "rrd", "print", str(rrd)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    stores = re.findall(r'StoreId\(\s*(\w+),\s*"(\w+)",\s*"([^"]+)"', text)
    assert ("Recording", APPLICATION, "a#6") in stores
    assert any(store[:2] == ("Blueprint", APPLICATION) for store in stores)
    for topic in ("/rope/points", "/rope/line", "/gripper", "/spline", "/topology"):
        assert f" - {topic} - " in text


@pytest.mark.slow
def test_only_timeline_is_time(recording, tmp_path):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    rrd = save_rerun(recording, tmp_path / "a.rrd")
    (found,) = reader(rrd).recordings()
    chunks = reader(rrd).stream(store=found).to_chunks()
    names = {name for chunk in chunks for name in chunk.timeline_names}
    assert names == {TIMELINE} == {"time"}
    assert any(chunk.entity_path == "/gripper" and chunk.timeline_names for chunk in chunks)


@pytest.mark.parametrize("camera", [False, True])
def test_scene_is_largest_view_and_its_name_a_legend(camera):
    pytest.importorskip("rerun")
    column = blueprint(camera).root_container
    assert column.row_shares[0] >= 0.8 * sum(column.row_shares)
    row = column.contents[0]
    view = row.contents[0] if camera else row
    for topic in view.contents:  # such as /rope/points: named by its first word
        assert topic.split("/")[1] in view.name.lower()
    assert {"table", "control points"} <= set(re.findall("table|control points", view.name))
    views = [type(one).__name__ for one in row.contents] if camera else [type(row).__name__]
    assert views == ["Spatial3DView", "Spatial2DView"][: 1 + camera]

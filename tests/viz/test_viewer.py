import io
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from knotflow.apps.cli import main
from knotflow.recording import messages, write_recording
from knotflow.viz import rerun_file, viewer
from knotflow.viz.viewer import check_recording, find_recording, show, why_not_headless

headless = pytest.mark.skipif(bool(why_not_headless()), reason=why_not_headless() or "can run")


@pytest.fixture
def folder(tmp_path, make_rollout):
    write_recording(tmp_path / "a.mcap", map(make_rollout, [4, 5]), {})
    write_recording(tmp_path / "b.mcap", map(make_rollout, [5, 6]), {"stage": "test"})
    return tmp_path


@pytest.fixture
def opened(monkeypatch):
    windows = []
    monkeypatch.setattr(
        viewer, "open_recording", lambda path, number: windows.append((path.name, number))
    )
    return windows


def test_number_finds_its_file(folder):
    assert find_recording(folder / "b.mcap", 99) == folder / "b.mcap"
    assert find_recording(folder) == folder / "a.mcap"
    assert find_recording(folder, 6) == folder / "b.mcap"
    with pytest.raises(ValueError, match="no rollout number 7; there are 4 rollouts from 4 to 6"):
        find_recording(folder, 7)
    with pytest.raises(ValueError, match=r"rollout 5 is in several .*a\.mcap.*b\.mcap"):
        find_recording(folder, 5)


def test_show_opens_the_recording_asked_for(folder, opened, capsys):
    assert show(folder / "b.mcap") == 0
    assert show(folder, 6) == 0
    assert capsys.readouterr().out.count("showing b.mcap of 2 recordings: a.mcap, b.mcap") == 1
    assert show(folder) == 0
    assert "showing a.mcap of 2 recordings" in capsys.readouterr().out
    assert opened == [("b.mcap", None), ("b.mcap", 6), ("a.mcap", None)]


def test_web_serves_instead_of_opening(folder, opened, monkeypatch):
    served = []
    monkeypatch.setattr(
        viewer, "serve_recording", lambda path, number: served.append((path.name, number))
    )
    assert show(folder, 6, web=True) == 0
    assert served == [("b.mcap", 6)] and opened == []


def test_address_of_the_page_is_printed(folder, monkeypatch, capsys):
    def run(command, check, env):
        assert command[command.index("--web-viewer-port") + 1] == "9100"
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(viewer, "save_rerun", lambda path, target, number: Path(target))
    monkeypatch.setattr(viewer.subprocess, "run", run)
    viewer.serve_recording(folder / "a.mcap", port=9100)
    page = "http://localhost:9100?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9101%2Fproxy"
    assert capsys.readouterr().out.startswith(page)


@pytest.mark.slow
def test_save_writes_a_file_and_opens_nothing(folder, opened, capsys):
    pytest.importorskip("rerun")
    target = folder / "out.rrd"
    assert show(folder / "a.mcap", 5, save=target) == 0
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


@pytest.mark.parametrize(("problems", "code"), [((), 0), (("view '3D': error: nothing drawn",), 1)])
def test_headless_check_prints_problems_and_keeps_the_picture(
    folder, opened, monkeypatch, capsys, problems, code
):
    report = viewer.HeadlessReport(problems, ("/gripper",), b"whole", b"scene")
    monkeypatch.setattr(viewer, "check_recording", lambda path, **options: report)
    picture = folder / "out.png"
    assert show(folder / "a.mcap", headless_check=picture) == code
    printed = capsys.readouterr()
    assert printed.err.splitlines() == list(problems)
    assert f"{len(problems)} problems; shows /gripper" in printed.out
    assert picture.read_bytes() == b"whole" and opened == []


def test_command_names_the_missing_driver(folder, monkeypatch, capsys):
    monkeypatch.setattr(viewer, "why_not_headless", lambda: "no Vulkan driver")
    assert main(["view", str(folder / "a.mcap"), "--headless-check", "out.png"]) == 1
    assert "no headless viewer can run here: no Vulkan driver" in capsys.readouterr().err


def pixels_like(png: bytes, rgb: tuple[int, int, int]) -> int:
    """How many pixels have the hue of a colour, however it is lit."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), float).reshape(-1, 3)
    bright = pixels[pixels.max(axis=1) > 60]
    unit = bright / np.linalg.norm(bright, axis=1, keepdims=True)
    return int((unit @ (np.array(rgb) / np.linalg.norm(rgb)) > 0.995).sum())


@headless
@pytest.mark.slow
def test_rerun_shows_rope_gripper_spline_and_topology(folder):
    report = check_recording(folder / "a.mcap", at=0.2)
    assert report.problems == ()
    assert set(viewer._TOPICS) <= set(report.entities)
    for name in ("HEAD_RGB", "TAIL_RGB", "GRIPPER_RGB", "SPLINE_RGB", "CONTROL_RGB"):
        assert pixels_like(report.scene, getattr(messages, name)) > 30, name
    assert len(report.screenshot) > len(report.scene) > 1000


@headless
@pytest.mark.slow
def test_headless_check_reports_what_rerun_cannot_draw(folder, monkeypatch):
    monkeypatch.setattr(rerun_file, "_LINES", ".entities[].no_such_field")
    problems = check_recording(folder / "a.mcap").problems
    assert len(problems) == 2  # the rope's line and the spline's
    assert all("error: Failed" in problem and len(problem) < 400 for problem in problems)

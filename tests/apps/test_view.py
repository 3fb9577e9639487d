from __future__ import annotations

import numpy as np
import pytest

from knotflow import view
from knotflow.recording import RecordedRollout, write_recording
from knotflow.viz import headless


def still_rope(number: int) -> RecordedRollout:
    times = np.arange(4) / 10
    points = np.zeros((4, 5, 3))
    points[:, :, 0] = np.linspace(-0.5, 0.5, 5)
    return RecordedRollout(
        times=times,
        points=points,
        gripper=points[:, 0],
        control_points=np.eye(3),
        spline=np.zeros(6),
        action="R1(0,1,1)",
        start_state="",
        goal_state="",
        end_state="",
        outcome="failure",
        signature="s",
        source="random",
        number=number,
    )


@pytest.fixture
def folder(tmp_path):
    write_recording(tmp_path / "a.mcap", [still_rope(1), still_rope(2)], {})
    write_recording(tmp_path / "b.mcap", [still_rope(3)], {})
    return tmp_path


@pytest.fixture
def opened(monkeypatch):
    windows = []
    monkeypatch.setattr(view, "open_recording", lambda path, number: windows.append((path, number)))
    return windows


def test_it_opens_what_was_asked(folder, opened, capsys):
    assert view.main([str(folder / "b.mcap")]) == 0
    assert view.main([str(folder), "--number", "3"]) == 0
    assert capsys.readouterr().out.count("showing b.mcap of 2 recordings: a.mcap, b.mcap") == 1
    assert view.main([str(folder)]) == 0
    assert "showing a.mcap of 2 recordings" in capsys.readouterr().out
    assert opened == [(folder / "b.mcap", None), (folder / "b.mcap", 3), (folder / "a.mcap", None)]


def test_web_serves_instead_of_opening(folder, opened, monkeypatch):
    served = []
    monkeypatch.setattr(view, "serve_recording", lambda path, number: served.append((path, number)))
    assert view.main([str(folder), "--number", "3", "--web"]) == 0
    assert served == [(folder / "b.mcap", 3)] and opened == []


@pytest.mark.slow
def test_save_writes_a_rerun_file_and_opens_nothing(folder, opened, capsys):
    pytest.importorskip("rerun")
    target = folder / "out.rrd"
    assert view.main([str(folder / "a.mcap"), "--number", "2", "--save", str(target)]) == 0
    assert target.stat().st_size > 1000 and str(target) in capsys.readouterr().out
    assert opened == []


@pytest.mark.parametrize(
    "make, arguments, words",
    [
        (None, ["missing.mcap"], "missing.mcap is not there"),
        ("text.mcap", ["text.mcap"], "text.mcap is not an MCAP file"),
        ("notes.txt", ["."], "there is: notes.txt"),
    ],
)
def test_bad_paths_are_named_in_one_line(
    tmp_path, monkeypatch, opened, capsys, make, arguments, words
):
    monkeypatch.chdir(tmp_path)
    if make:
        (tmp_path / make).write_text("hello, this is no recording")
    assert view.main(arguments) == 1
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1 and error.startswith("knotflow.view: ")
    assert opened == []


def test_a_number_that_is_not_there(folder, opened, capsys):
    assert view.main([str(folder), "--number", "9"]) == 1
    assert "no rollout number 9; there are 3 rollouts from 1 to 3" in capsys.readouterr().err
    assert opened == []


@pytest.mark.parametrize("problems, code", [((), 0), (("view '3D': error: nothing drawn",), 1)])
def test_headless_check_tells_problems_and_keeps_the_picture(
    folder, opened, monkeypatch, capsys, problems, code
):
    report = headless.HeadlessReport(problems, ("/gripper",), b"whole", b"scene")
    monkeypatch.setattr(headless, "why_not_headless", lambda: "")
    monkeypatch.setattr(headless, "check_recording", lambda path, **options: report)
    picture = folder / "out.png"
    assert view.main([str(folder / "a.mcap"), "--headless-check", str(picture)]) == code
    printed = capsys.readouterr()
    assert printed.err.splitlines() == list(problems)
    assert f"{len(problems)} problems; shows /gripper" in printed.out
    assert picture.read_bytes() == b"whole" and opened == []


def test_headless_check_says_what_is_missing(folder, monkeypatch, capsys):
    monkeypatch.setattr(headless, "why_not_headless", lambda: "no Vulkan driver")
    assert view.main([str(folder / "a.mcap"), "--headless-check"]) == 1
    assert "no headless viewer can run here: no Vulkan driver" in capsys.readouterr().err

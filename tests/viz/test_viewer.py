from __future__ import annotations

import re
import subprocess

import pytest

from knotflow.recording import (
    DamagedRecordingError,
    ViewerError,
    blueprint,
    find_recording,
    read_recording,
    save_rerun,
    viewer,
    write_recording,
)


@pytest.fixture
def folder(tmp_path, make_rollout):
    place = tmp_path / "data"
    place.mkdir()
    write_recording(place / "a.mcap", map(make_rollout, [4, 5]), {})
    write_recording(place / "b.mcap", map(make_rollout, [5, 6]), {"stage": "test"})
    return place


@pytest.fixture
def rerun_calls(monkeypatch):
    """Instead of running Rerun, keep what it would have been asked, and what it would show."""
    calls = []

    def convert(source, target, name) -> None:
        shown = [rollout.number for rollout in read_recording(source)]
        calls.append((("convert", str(source), name), shown))

    monkeypatch.setattr(viewer, "_convert", convert)
    monkeypatch.setattr(viewer, "_rerun", lambda *arguments: calls.append((arguments, [])))
    return calls


def test_a_number_finds_its_file(folder):
    assert find_recording(folder / "b.mcap", 99) == folder / "b.mcap"
    assert find_recording(folder) == folder / "a.mcap"
    assert find_recording(folder, 6) == folder / "b.mcap"
    with pytest.raises(ValueError, match="no rollout number 7; there are 4 rollouts from 4 to 6"):
        find_recording(folder, 7)
    with pytest.raises(ValueError, match=r"rollout 5 is in several .*a\.mcap.*b\.mcap"):
        find_recording(folder, 5)


def test_the_rollouts_asked_for_are_shown(folder, rerun_calls):
    save_rerun(folder / "b.mcap", "out.rrd")
    save_rerun(folder, "out.rrd", number=6)
    assert [shown for _, shown in rerun_calls if shown] == [[5, 6], [6]]
    assert rerun_calls[1][0][:2] == ("rrd", "merge") and rerun_calls[1][0][-1] == "out.rrd"
    with pytest.raises(ValueError, match="no rollout number 9; there are 2 rollouts from 5 to 6"):
        save_rerun(folder / "b.mcap", "out.rrd", number=9)


def test_a_damaged_recording_is_not_shown_in_part(tmp_path, make_rollout, rerun_calls):
    path = tmp_path / "changed.mcap"
    write_recording(path, map(make_rollout, range(30)), {})
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 255
    path.write_bytes(whole)
    with pytest.raises(DamagedRecordingError, match="mcap recover"):
        save_rerun(path, "out.rrd")
    assert rerun_calls == []


def test_what_rerun_refuses_is_told(tmp_path):
    pytest.importorskip("rerun")
    with pytest.raises(ViewerError, match=r"rerun rrd merge .*nothing\.rrd"):
        viewer._rerun("rrd", "merge", str(tmp_path / "nothing.rrd"))


def test_the_saved_file_holds_recording_and_blueprint(tmp_path, make_rollout):
    pytest.importorskip("rerun")
    write_recording(tmp_path / "a.mcap", [make_rollout(1), make_rollout(2)], {})
    rrd = save_rerun(tmp_path / "a.mcap", tmp_path / "a.rrd", number=2)
    command = [viewer.rerun_program(), "rrd", "print", str(rrd)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    stores = re.findall(r'StoreId\(\s*(\w+),\s*"(\w+)",\s*"([^"]+)"', text)
    assert ("Recording", viewer.APPLICATION, "a#2") in stores
    assert any(store[:2] == ("Blueprint", viewer.APPLICATION) for store in stores)
    for topic in ("/rope/points", "/rope/line", "/gripper", "/spline", "/topology"):
        assert f" - {topic} - " in text


def test_the_one_timeline_is_called_time(tmp_path, make_rollout):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    write_recording(tmp_path / "a.mcap", [make_rollout(1)], {})
    rrd = save_rerun(tmp_path / "a.mcap", tmp_path / "a.rrd")
    (recording,) = reader(rrd).recordings()
    chunks = reader(rrd).stream(store=recording).to_chunks()
    names = {name for chunk in chunks for name in chunk.timeline_names}
    assert names == {blueprint.TIMELINE} == {"time"}
    assert any(chunk.entity_path == "/gripper" and chunk.timeline_names for chunk in chunks)


@pytest.mark.parametrize("camera", [False, True])
def test_the_scene_is_the_largest_view_and_its_name_is_a_legend_of_all_it_draws(camera):
    pytest.importorskip("rerun")
    column = blueprint.blueprint(0.008, camera).root_container
    assert column.row_shares[0] >= 0.8 * sum(column.row_shares)
    view = column.contents[0].contents[0] if camera else column.contents[0]
    for topic in view.contents:  # such as /rope/points: named by its first word
        assert topic.split("/")[1] in view.name.lower()
    assert {"table", "control points"} <= set(re.findall("table|control points", view.name))


def test_the_address_of_the_page_is_printed(folder, monkeypatch, rerun_calls, capsys):
    def run(command, check, env):
        assert command[command.index("--web-viewer-port") + 1] == "9100"
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(viewer.subprocess, "run", run)
    viewer.serve_recording(folder, port=9100)
    page = "http://localhost:9100?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9101%2Fproxy"
    assert capsys.readouterr().out.startswith(page)

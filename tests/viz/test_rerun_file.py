import re
import subprocess

import pytest

from knotflow.recording import DamagedRecordingError, write_recording
from knotflow.viz import rerun_file
from knotflow.viz.rerun_file import APPLICATION, TIMELINE, ViewerError, blueprint, save_rerun


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
def test_error_of_rerun_is_quoted(tmp_path):
    pytest.importorskip("rerun")
    with pytest.raises(ViewerError, match=r"rerun rrd merge .*nothing\.rrd"):
        rerun_file.run_rerun("rrd", "merge", str(tmp_path / "nothing.rrd"))


@pytest.mark.slow
def test_saved_file_holds_recording_and_blueprint(recording, tmp_path):
    pytest.importorskip("rerun")
    rrd = save_rerun(recording, tmp_path / "a.rrd", number=6)
    command = [rerun_file.rerun_program(), "rrd", "print", str(rrd)]
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

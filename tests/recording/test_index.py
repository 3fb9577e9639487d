from __future__ import annotations

import os

import pyarrow.parquet as pq
import pytest

from knotflow.recording import (
    DamagedRecordingError,
    NotARecordingError,
    index,
    write_index,
    write_recording,
)


@pytest.fixture
def folder(tmp_path, make_rollout):
    for shard in range(3):
        numbers = range(40 * shard, 40 * shard + 40)
        rollouts = (make_rollout(number, frames=3) for number in numbers)
        write_recording(tmp_path / f"shard-{shard}.mcap", rollouts, {})
    return tmp_path


def test_one_row_a_rollout_in_order(folder, make_rollout):
    path = write_index(folder)
    assert path == folder / "index.parquet"
    rows = pq.read_table(path).to_pylist()
    assert [row["number"] for row in rows] == list(range(120))
    assert [row["file"] for row in rows[::40]] == [f"shard-{shard}.mcap" for shard in range(3)]
    row, rollout = rows[41], make_rollout(41, frames=3)
    spline = [row[name] for name in index.SPLINE_COLUMNS]
    assert spline == rollout.spline.tolist()
    assert (row["action"], row["outcome"], row["source"]) == ("C(0,1,1)", "success", "scripted")
    assert (row["start_time_s"], row["duration_s"]) == (3.0, 2.5)  # one rollout and a gap later
    assert row["extra"] == '{"demonstration": "41"}'
    assert sorted(os.listdir(folder))[0] == "index.parquet"  # no partial file left


def test_facts_are_read_without_trajectories(folder, monkeypatch):
    monkeypatch.setattr("knotflow.recording.reader.cloud_points", None)
    assert pq.read_table(write_index(folder)).num_rows == 120


def test_only_changed_files_are_read_again(folder, make_rollout, monkeypatch):
    write_index(folder)
    assert index.fresh_index(folder) is not None
    read = []
    original = index.file_table
    monkeypatch.setattr(index, "file_table", lambda path: read.append(path.name) or original(path))

    write_recording(folder / "shard-1.mcap", [make_rollout(500)], {})
    (folder / "shard-2.mcap").unlink()
    write_recording(folder / "shard-3.mcap", [make_rollout(600)], {})
    assert index.fresh_index(folder) is None
    table = pq.read_table(write_index(folder))
    assert table["number"].to_pylist() == [*range(40), 500, 600]
    assert read == ["shard-1.mcap", "shard-3.mcap"]


def test_a_damaged_file_is_refused_and_leaves_the_old_index(folder):
    written = write_index(folder).read_bytes()
    path = folder / "shard-1.mcap"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(DamagedRecordingError, match="shard-1.mcap is damaged"):
        write_index(folder)
    path.write_bytes(whole.replace(b"\x28\xb5\x2f\xfd", b"\x28\xb5\x2f\xfe", 1))  # zstd's magic
    with pytest.raises(DamagedRecordingError, match="shard-1.mcap is damaged"):
        write_index(folder)
    assert (folder / "index.parquet").read_bytes() == written


def test_bad_folders_say_what_is_there(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        write_index(tmp_path / "nowhere")
    (tmp_path / "notes.txt").write_text("")
    (tmp_path / "sub").mkdir()
    with pytest.raises(FileNotFoundError, match=r"no \*\.mcap recording .*: notes.txt, sub/"):
        write_index(tmp_path)
    (tmp_path / "fake.mcap").write_text("not one")
    with pytest.raises(NotARecordingError, match="fake.mcap is not an MCAP"):
        write_index(tmp_path)

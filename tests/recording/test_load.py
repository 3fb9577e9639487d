from __future__ import annotations

import os

import numpy as np
import pandas as pd
import pytest

from knotflow.recording import (
    DamagedRecordingError,
    NotARecordingError,
    load,
    messages,
    reader,
    write_recording,
)


@pytest.fixture
def folder(tmp_path, make_rollout):
    place = tmp_path / "data"
    place.mkdir()
    write_recording(place / "a.mcap", [make_rollout(n) for n in range(3)], {})
    write_recording(place / "b.mcap", [make_rollout(n) for n in range(3, 8)], {})
    return place


def test_load_accepts_file_folder_and_list(folder):
    whole = load(folder)
    assert whole["number"].tolist() == list(range(8))
    assert all(os.path.isfile(file) for file in whole["file"])
    parts = [load(folder / "a.mcap"), load(str(folder / "b.mcap"))]
    pd.testing.assert_frame_equal(whole, pd.concat(parts, ignore_index=True))
    pd.testing.assert_frame_equal(whole, load([folder / "a.mcap", folder / "b.mcap"]))
    pd.testing.assert_frame_equal(whole, load(iter([folder])))
    assert whole.loc[5, "extra"] == {"demonstration": "5"}


def test_load_returns_written_trajectories(folder, make_rollout):
    frame = load(folder, trajectories=True)
    pd.testing.assert_frame_equal(
        frame.drop(columns=["times", "points", "gripper", "control_points"]),
        load(folder),
        check_dtype=False,
    )
    for _, row in frame.iterrows():
        rollout = make_rollout(row["number"])
        for name in ("times", "points", "gripper", "control_points"):
            np.testing.assert_array_equal(row[name], getattr(rollout, name))


def test_load_of_nothing_has_all_columns(folder):
    assert load([]).columns.tolist() == load(folder).columns.tolist()
    wide = load(folder, trajectories=True).columns.tolist()
    assert load([], trajectories=True).columns.tolist() == wide


def test_load_names_missing_paths(folder):
    with pytest.raises(FileNotFoundError, match="recordings beside it: a.mcap, b.mcap"):
        load(folder / "z.mcap")
    with pytest.raises(FileNotFoundError, match=r"z\.mcap"):
        load([folder, folder / "z.mcap"], trajectories=True)


@pytest.fixture
def shards(tmp_path, make_rollout):
    for shard in range(3):
        numbers = range(40 * shard, 40 * shard + 40)
        rollouts = (make_rollout(number, frames=3) for number in numbers)
        write_recording(tmp_path / f"shard-{shard}.mcap", rollouts, {})
    return tmp_path


def test_table_has_one_row_a_rollout_in_order(shards, make_rollout):
    table = load(shards)
    assert table["number"].tolist() == list(range(120))
    files = [str(shards / f"shard-{shard}.mcap") for shard in range(3)]
    assert table["file"][::40].tolist() == files
    row, rollout = table.loc[41], make_rollout(41, frames=3)
    assert row[[*messages.SPLINE_COLUMNS]].tolist() == rollout.spline.tolist()
    assert (row["action"], row["outcome"], row["source"]) == ("C(0,1,1)", "success", "scripted")
    assert (row["start_time_s"], row["duration_s"]) == (3.0, 2.5)  # one rollout and a gap later
    assert row["extra"] == {"demonstration": "41"}


def test_table_reads_no_trajectories(shards, monkeypatch):
    monkeypatch.setitem(reader._DECODERS, messages.ROPE, None)
    assert len(load(shards)) == 120


def test_damaged_file_is_named(shards):
    path = shards / "shard-1.mcap"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(DamagedRecordingError, match="shard-1.mcap is damaged"):
        load(shards)
    path.write_bytes(whole.replace(b"\x28\xb5\x2f\xfd", b"\x28\xb5\x2f\xfe", 1))  # zstd's magic
    with pytest.raises(DamagedRecordingError, match="shard-1.mcap is damaged"):
        load(shards)


def test_errors_list_folder_contents(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere is not there"):
        load(tmp_path / "nowhere")
    (tmp_path / "notes.txt").write_text("")
    (tmp_path / "sub").mkdir()
    with pytest.raises(FileNotFoundError, match=r"no \*\.mcap recording .*: notes.txt, sub/"):
        load(tmp_path)
    (tmp_path / "fake.mcap").write_text("not one")
    with pytest.raises(NotARecordingError, match="fake.mcap is not an MCAP"):
        load(tmp_path)

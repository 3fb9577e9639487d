from __future__ import annotations

import os

import numpy as np
import pandas as pd
import pytest

from knotflow.recording import load, write_recording


@pytest.fixture
def folder(tmp_path, make_rollout):
    place = tmp_path / "data"
    place.mkdir()
    write_recording(place / "a.mcap", [make_rollout(n) for n in range(3)], {})
    write_recording(place / "b.mcap", [make_rollout(n) for n in range(3, 8)], {})
    return place


def test_file_folder_and_list_agree(folder):
    whole = load(folder)
    assert whole["number"].tolist() == list(range(8))
    assert all(os.path.isfile(file) for file in whole["file"])
    parts = [load(folder / "a.mcap"), load(str(folder / "b.mcap"))]
    pd.testing.assert_frame_equal(whole, pd.concat(parts, ignore_index=True))
    pd.testing.assert_frame_equal(whole, load([folder / "a.mcap", folder / "b.mcap"]))
    pd.testing.assert_frame_equal(whole, load(iter([folder])))
    assert whole.loc[5, "extra"] == {"demonstration": "5"}


def test_trajectories_are_those_written(folder, make_rollout):
    table = load(folder, trajectories=True)
    pd.testing.assert_frame_equal(
        table.drop(columns=["times", "points", "gripper", "control_points"]),
        load(folder),
        check_dtype=False,
    )
    for _, row in table.iterrows():
        rollout = make_rollout(row["number"])
        for name in ("times", "points", "gripper", "control_points"):
            np.testing.assert_array_equal(row[name], getattr(rollout, name))


def test_an_old_index_is_not_believed(folder, make_rollout):
    assert len(load(folder)) == 8
    write_recording(folder / "c.mcap", [make_rollout(8)], {})
    assert len(load(folder)) == 9
    (folder / "a.mcap").unlink()
    assert load(folder)["number"].tolist() == [3, 4, 5, 6, 7, 8]


def test_a_folder_we_may_only_read_is_loaded_without_leaving_an_index(folder, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert len(load(folder)) == 8
    assert sorted(os.listdir(folder)) == ["a.mcap", "b.mcap"]


def test_nothing_asked_gives_an_empty_table_of_the_same_columns(folder):
    assert load([]).columns.tolist() == load(folder).columns.tolist()
    wide = load(folder, trajectories=True).columns.tolist()
    assert load([], trajectories=True).columns.tolist() == wide


def test_missing_paths_are_errors(folder):
    with pytest.raises(FileNotFoundError, match="recordings beside it: a.mcap, b.mcap"):
        load(folder / "z.mcap")
    with pytest.raises(FileNotFoundError, match=r"z\.mcap"):
        load([folder, folder / "z.mcap"], trajectories=True)

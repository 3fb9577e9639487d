"""Recordings as pandas tables, one row a rollout."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from .index import SCHEMA, file_table, fresh_index, index_table, recordings_in, write_index
from .reader import existing_recording, read_with_facts

TRAJECTORY_COLUMNS = ("times", "points", "gripper", "control_points")
PathLike = str | os.PathLike[str]


def load(path: PathLike | Iterable[PathLike], *, trajectories: bool = False) -> pd.DataFrame:
    """All rollouts of a recording, of a folder of recordings, or of a list of either.

    Args:
        path: a file, a folder (its index is used, and brought up to date if need be), or several.
        trajectories: also read the arrays, as columns ``times`` (T,) s, ``points`` (T, V, 3) m,
            ``gripper`` (T, 3) m and ``control_points`` (3, 3) m with one numpy array a row.

    Returns:
        One row a rollout, files by name and rollouts in file order, with the columns of
        ``index.SCHEMA``; ``file`` is a path that can be opened and ``extra`` a dict.

    Raises:
        FileNotFoundError: a file or folder is not there, or a folder holds no recording.
        NotARecordingError, DamagedRecordingError: a file is no recording, or cut or changed.
    """
    if not isinstance(path, (str, os.PathLike)):
        frames = [load(each, trajectories=trajectories) for each in path]
        return pd.concat(frames, ignore_index=True) if frames else _empty(trajectories)
    place = Path(path)
    if trajectories:
        return _with_arrays(recordings_in(place) if place.is_dir() else [existing_recording(place)])
    if place.is_dir():
        return _frame(_index_of(place), place)
    return _frame(file_table(place), place.parent)


def _index_of(folder: Path) -> pa.Table:
    fresh = fresh_index(folder)
    if fresh is not None:
        return fresh
    if os.access(folder, os.W_OK):
        return pq.read_table(write_index(folder))
    return index_table(folder)  # a folder we may only read keeps no index


def _frame(table: pa.Table, folder: Path) -> pd.DataFrame:
    frame = table.to_pandas()
    frame["file"] = [str(folder / name) for name in frame["file"]]
    frame["extra"] = [json.loads(text) for text in frame["extra"]]
    return frame


def _with_arrays(files: list[Path]) -> pd.DataFrame:
    rows = [
        {
            "file": str(file),
            **facts.row(),
            **{name: getattr(rollout, name) for name in TRAJECTORY_COLUMNS},
        }
        for file in files
        for facts, rollout in read_with_facts(file)
    ]
    return pd.DataFrame(rows, columns=[*SCHEMA.names, *TRAJECTORY_COLUMNS])


def _empty(trajectories: bool) -> pd.DataFrame:
    frame = SCHEMA.empty_table().to_pandas()
    return frame.reindex(columns=[*frame.columns, *(TRAJECTORY_COLUMNS if trajectories else ())])

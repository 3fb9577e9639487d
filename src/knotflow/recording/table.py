"""Recordings as pandas tables, one row a rollout.

A folder's table is kept beside its recordings as ``index.parquet``, and made again once they have
changed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.reader import make_reader

from . import messages
from .reader import damage_named, existing_recording, read_with_facts

INDEX_NAME = "index.parquet"
SCHEMA = pa.schema(
    [
        pa.field("file", pa.string()),  # its name in the folder
        pa.field("number", pa.int64()),
        pa.field("start_time_s", pa.float64()),  # on the file's timeline
        pa.field("duration_s", pa.float64()),
        pa.field("action", pa.string()),
        *(pa.field(name, pa.float64()) for name in messages.SPLINE_COLUMNS),
        pa.field("start_state", pa.string()),
        pa.field("goal_state", pa.string()),
        pa.field("end_state", pa.string()),
        pa.field("outcome", pa.string()),
        pa.field("source", pa.string()),
        pa.field("signature", pa.string()),
        pa.field("extra", pa.string()),  # JSON of a mapping of texts
    ]
)
TRAJECTORY_COLUMNS = ("times", "points", "gripper", "control_points")
PathLike = str | os.PathLike[str]
_STAMPS = b"knotflow.files"  # size and time of the indexed files, in the Parquet metadata


def load(path: PathLike | Iterable[PathLike], *, trajectories: bool = False) -> pd.DataFrame:
    """All rollouts of a recording, of a folder of recordings, or of a list of either.

    Args:
        path: a file, a folder (its index is used, and brought up to date if need be), or several.
        trajectories: also read the arrays, as columns ``times`` (T,) s, ``points`` (T, V, 3) m,
            ``gripper`` (T, 3) m and ``control_points`` (3, 3) m with one numpy array a row.

    Returns:
        One row a rollout, files by name and rollouts in file order, with the columns of
        ``SCHEMA``; ``file`` is a path that can be opened and ``extra`` a dict.

    Raises:
        FileNotFoundError: a file or folder is not there, or a folder holds no recording.
        NotARecordingError, DamagedRecordingError: a file is no recording, or cut or changed.
    """
    arrays = TRAJECTORY_COLUMNS if trajectories else ()
    if not isinstance(path, str | os.PathLike):
        frames = [load(each, trajectories=trajectories) for each in path]
        empty = SCHEMA.empty_table().to_pandas()
        empty = empty.reindex(columns=[*empty.columns, *arrays])
        return pd.concat(frames, ignore_index=True) if frames else empty
    place = Path(path)
    if trajectories:
        files = recordings_in(place) if place.is_dir() else [existing_recording(place)]
        rows = [
            {"file": str(file)}
            | messages.table_row(facts)
            | {name: getattr(rollout, name) for name in arrays}
            for file in files
            for facts, rollout in read_with_facts(file)
        ]
        return pd.DataFrame(rows, columns=[*SCHEMA.names, *arrays])
    folder = place if place.is_dir() else place.parent
    frame = (_folder_table(place) if place.is_dir() else file_table(place)).to_pandas()
    frame["file"] = [str(folder / name) for name in frame["file"]]
    frame["extra"] = [json.loads(text) for text in frame["extra"]]
    return frame


def write_index(folder: PathLike) -> Path:
    """Bring ``index.parquet`` of a folder up to date; its columns are those of ``SCHEMA``.

    Returns:
        The index file.

    Raises:
        FileNotFoundError: no such folder, or no recording in it.
        NotARecordingError, DamagedRecordingError: a ``*.mcap`` in it is no recording, or none
            that can be read.
    """
    _folder_table(Path(folder))
    return Path(folder) / INDEX_NAME


def file_table(path: Path) -> pa.Table:
    """The index rows of one recording.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: as for ``read_recording``.
    """
    facts = _facts_of_complete_file(existing_recording(path))
    if facts is None:  # only reading it through shows which rollouts are whole
        facts = [each for each, _ in read_with_facts(path)]
    rows = [{"file": path.name, **messages.table_row(each)} for each in facts]
    for row in rows:
        row["extra"] = json.dumps(row["extra"], sort_keys=True)
    return pa.Table.from_pylist(rows, schema=SCHEMA)


def recordings_in(folder: Path) -> list[Path]:
    """The ``*.mcap`` files of a folder, by name.

    Raises:
        FileNotFoundError: no such folder, or no recording in it; names what is there instead.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    files = sorted(folder.glob("*.mcap"))
    if not files:
        there = sorted(child.name + "/" * child.is_dir() for child in folder.iterdir())
        more = f" and {len(there) - 12} more" if len(there) > 12 else ""
        raise FileNotFoundError(
            f"no *.mcap recording in {folder}; there is: {', '.join(there[:12]) or 'nothing'}{more}"
        )
    return files


def _folder_table(folder: Path) -> pa.Table:
    """The rows of a folder: its index, which is written first if it is stale and one may write."""
    path, files = folder / INDEX_NAME, recordings_in(folder)
    stats = {file.name: file.stat() for file in files}
    stamps = json.dumps({name: [stat.st_size, stat.st_mtime_ns] for name, stat in stats.items()})
    if path.is_file():
        stored = pq.read_table(path)
        current = (stored.schema.metadata or {}).get(_STAMPS) == stamps.encode()
        if current and stored.schema.names == SCHEMA.names:
            return stored
    table = pa.concat_tables([file_table(file) for file in files])
    table = table.replace_schema_metadata({_STAMPS: stamps})
    if os.access(folder, os.W_OK):
        partial = path.with_name(f".{INDEX_NAME}.partial")
        pq.write_table(table, partial)
        partial.replace(path)
    return table


def _facts_of_complete_file(path: Path) -> list[Any] | None:
    """Each ``knotflow.Rollout`` of a file whose summary accounts for every frame, else None."""
    with path.open("rb") as stream, damage_named(path):
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            return None
        found = reader.iter_messages(messages.ROLLOUT, log_time_order=False)
        facts = [messages.RolloutMessage.FromString(message.data) for _, _, message in found]
    counts = {
        summary.channels[channel].topic: count
        for channel, count in summary.statistics.channel_message_counts.items()
    }
    frames = sum(each.frames for each in facts)
    complete = counts.get(messages.ROPE) == counts.get(messages.GRIPPER) == frames
    return facts if facts and complete else None

"""The table of all rollouts in a folder, kept beside them as ``index.parquet``.

The index is a by-product: it can always be rebuilt from the recordings, and is
reproduced for those that have changed since. It reads only facts, never trajectories.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from mcap.reader import make_reader

from . import topics
from .facts import SPLINE_COLUMNS, Facts, RolloutMessage
from .reader import damage_named, existing_recording, read_with_facts
from .writer import sync_folder

INDEX_NAME = "index.parquet"
SCHEMA = pa.schema(
    [
        pa.field("file", pa.string()),  # its name in the folder
        pa.field("number", pa.int64()),
        pa.field("start_time_s", pa.float64()),  # on the file's timeline
        pa.field("duration_s", pa.float64()),
        pa.field("action", pa.string()),
        *(pa.field(name, pa.float64()) for name in SPLINE_COLUMNS),
        pa.field("start_state", pa.string()),
        pa.field("goal_state", pa.string()),
        pa.field("end_state", pa.string()),
        pa.field("outcome", pa.string()),
        pa.field("source", pa.string()),
        pa.field("signature", pa.string()),
        pa.field("extra", pa.string()),  # JSON of a mapping of texts
    ]
)
_FILES = b"knotflow.files"  # key of the indexed files' stamps in the Parquet metadata


def write_index(folder: str | os.PathLike[str]) -> Path:
    """Bring ``index.parquet`` of a folder up to date with its ``*.mcap`` files.

    Rows of files whose size and modification time are as before are taken over; of the others,
    the facts are read. Its columns are those of ``SCHEMA``.

    Returns:
        The index file.

    Raises:
        FileNotFoundError: no such folder, or no recording in it.
        NotARecordingError, DamagedRecordingError: a ``*.mcap`` in it is no recording, or none
            that can be read.
    """
    place = Path(folder)
    path = place / INDEX_NAME
    table = index_table(place)
    partial = path.with_name(f".{INDEX_NAME}.partial")
    pq.write_table(table, partial)
    partial.replace(path)
    sync_folder(place)
    return path


def index_table(folder: Path) -> pa.Table:
    """What the index of a folder should hold now, reusing the rows of unchanged files.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: as for ``write_index``.
    """
    stamps = _stamps(folder)
    old = _stored(folder)
    known = _indexed_files(old)
    parts = []
    for name, stamp in stamps.items():
        unchanged = known.get(name) == stamp
        parts.append(
            old.filter(pc.equal(old["file"], name)) if unchanged else file_table(folder / name)
        )
    table = pa.concat_tables([part.replace_schema_metadata(None) for part in parts])
    return table.replace_schema_metadata({_FILES: json.dumps(stamps)})


def fresh_index(folder: Path) -> pa.Table | None:
    """The index as stored, if it holds every file of the folder as it is now.

    Raises:
        FileNotFoundError: no such folder, or no recording in it.
    """
    table = _stored(folder)
    return table if _indexed_files(table) == _stamps(folder) else None


def file_table(path: Path) -> pa.Table:
    """The index rows of one recording.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: as for ``read_recording``.
    """
    facts = _facts_of_whole_file(existing_recording(path))
    if facts is None:  # only reading it through shows which rollouts are whole
        facts = [each for each, _ in read_with_facts(path)]
    rows = [{"file": path.name, **each.row()} for each in facts]
    for row in rows:
        row["extra"] = json.dumps(row["extra"], sort_keys=True)
    return pa.Table.from_pylist(rows, schema=SCHEMA)


def recordings_in(folder: Path) -> list[Path]:
    """The ``*.mcap`` files of a folder, by name.

    Raises:
        FileNotFoundError: no such folder, or no recording in it; says what is there instead.
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


def _facts_of_whole_file(path: Path) -> list[Facts] | None:
    """The facts of a file whose summary accounts for every frame, else None."""
    with path.open("rb") as stream, damage_named(path):
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            return None
        messages = reader.iter_messages(topics.ROLLOUT, log_time_order=False)
        facts = [Facts(RolloutMessage.FromString(message.data)) for _, _, message in messages]
    topic_of = {channel.id: channel.topic for channel in summary.channels.values()}
    counts = {
        topic_of[channel]: count
        for channel, count in summary.statistics.channel_message_counts.items()
    }
    frames = sum(each.frames for each in facts)
    whole = facts and counts.get(topics.ROPE) == counts.get(topics.GRIPPER) == frames
    return facts if whole else None


def _stored(folder: Path) -> pa.Table:
    """The stored index; an empty one if there is none, or only of another version."""
    path = folder / INDEX_NAME
    table = pq.read_table(path) if path.is_file() else None
    return table if table and table.schema.names == SCHEMA.names else SCHEMA.empty_table()


def _indexed_files(table: pa.Table) -> dict[str, Any]:
    files: dict[str, Any] = json.loads((table.schema.metadata or {}).get(_FILES, b"{}"))
    return files


def _stamps(folder: Path) -> dict[str, list[int]]:
    """Size and modification time of each recording: by which a changed file is noticed."""
    stats = {file.name: file.stat() for file in recordings_in(folder)}
    return {name: [stat.st_size, stat.st_mtime_ns] for name, stat in stats.items()}

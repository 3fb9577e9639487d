"""Recordings as pandas tables, one row a rollout."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd
from mcap.reader import make_reader

from . import messages
from .reader import damage_named, existing_recording, read_with_facts

COLUMNS = {
    "file": str,
    "number": "int64",
    "start_time_s": float,  # on the file's timeline
    "duration_s": float,
    "action": str,
    **dict.fromkeys(messages.SPLINE_COLUMNS, float),
    **dict.fromkeys(("start_state", "goal_state", "end_state", "outcome", "source"), str),
    "signature": str,
    "extra": object,  # a mapping of texts
}
TRAJECTORY_COLUMNS = ("times", "points", "gripper", "control_points")
PathLike = str | os.PathLike[str]


def load(path: PathLike | Iterable[PathLike], *, trajectories: bool = False) -> pd.DataFrame:
    """All rollouts of a recording, of a folder of recordings, or of a list of either.

    Args:
        path: a file, a folder, or several.
        trajectories: also read the arrays, as columns ``times`` (T,) s, ``points`` (T, V, 3) m,
            ``gripper`` (T, 3) m and ``control_points`` (3, 3) m with one numpy array a row.

    Returns:
        One row a rollout, files by name and rollouts in file order, with the columns of
        ``COLUMNS``; ``file`` is a path that can be opened and ``extra`` a dict.

    Raises:
        FileNotFoundError: a file or folder is not there, or a folder holds no recording.
        NotARecordingError, DamagedRecordingError: a file is no recording, or cut or changed.
    """
    paths = [path] if isinstance(path, str | os.PathLike) else path
    arrays = TRAJECTORY_COLUMNS if trajectories else ()
    rows: list[dict[str, Any]] = []
    for place in map(Path, paths):
        for file in recordings_in(place) if place.is_dir() else [place]:
            facts = None if trajectories else _facts_of_complete_file(file)
            read = read_with_facts(file) if facts is None else ((one, None) for one in facts)
            for one, rollout in read:
                values = {name: getattr(rollout, name) for name in arrays}
                rows.append({"file": str(file)} | messages.table_row(one) | values)
    return pd.DataFrame(rows, columns=[*COLUMNS, *arrays]).astype(COLUMNS)


def recordings_in(folder: Path) -> list[Path]:
    """The ``*.mcap`` files of a folder, by name.

    Raises:
        FileNotFoundError: no recording is in it; names what is there instead.
    """
    files = sorted(folder.glob("*.mcap"))
    if not files:
        there = sorted(child.name + "/" * child.is_dir() for child in folder.iterdir())
        more = f" and {len(there) - 12} more" if len(there) > 12 else ""
        raise FileNotFoundError(
            f"no *.mcap recording in {folder}; there is: {', '.join(there[:12]) or 'nothing'}{more}"
        )
    return files


def _facts_of_complete_file(path: Path) -> list[Any] | None:
    """Each ``knotflow.Rollout`` of a file whose summary accounts for every frame, else None."""
    with existing_recording(path).open("rb") as stream, damage_named(path):
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

"""Recordings read back, as rollouts or as a pandas table, with every checksum compared.

A cut or changed file is an error here; its repair is left to the mcap command (`mcap recover`).
"""

from __future__ import annotations

import os
import struct
import warnings
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import MCAP0_MAGIC as MAGIC

from . import messages
from .rollout import RecordedRollout, RolloutImages

# What mcap and the codecs under it raise on changed bytes.
_UNREADABLE = (
    *(McapError, DecodeError, struct.error, zstandard.ZstdError),
    *(ValueError, LookupError, OverflowError, MemoryError),
)
_DECODERS = {
    messages.ROPE: messages.cloud_points,
    messages.GRIPPER: messages.gripper_position,
    messages.CAMERA: messages.image_file,
    messages.ESTIMATE: messages.cloud_points,
    messages.REFERENCE: messages.cloud_points,
}

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


class NotARecordingError(ValueError):
    """The file is no MCAP at all, or an MCAP in which no rollout was ever recorded."""


class DamagedRecordingError(ValueError):
    """A recording was cut or changed after it was written; names the command that repairs it."""

    def __init__(self, path: Path, reason: object) -> None:
        super().__init__(
            f"{path} is damaged: {reason}. What can be saved of it is saved by "
            f"`mcap recover {path.name} -o recovered.mcap` (https://mcap.dev/guides/cli)"
        )


def read_recording(path: PathLike) -> Iterator[RecordedRollout]:
    """The rollouts of a recording, in file order, one in memory at a time.

    Trajectories come back as the exact float32 numbers that were written, splines and control
    points as the exact float64, times to 1 ns. A recovered file may announce rollouts whose
    frames are lost: these are left out, with a warning that counts them.

    Raises:
        FileNotFoundError: there is no such file (raised at once, not at the first rollout).
        NotARecordingError: it is no MCAP (at once), or holds no whole rollout.
        DamagedRecordingError: it is cut (at once), or a checksum is wrong (where this is met).
    """
    return (rollout for _, rollout in _rollouts(existing_recording(path)))


def load(path: PathLike | Iterable[PathLike], *, trajectories: bool = False) -> pd.DataFrame:
    """All rollouts of a recording, of a folder of recordings, or of a list of either.

    A row is a rollout, files by name and rollouts in file order, with the columns of ``COLUMNS``;
    ``file`` is a path that can be opened and ``extra`` a dict. With ``trajectories``, columns of
    arrays follow: ``times`` (T,) s, ``points`` (T, V, 3) m, ``gripper`` (T, 3) m and
    ``control_points`` (3, 3) m.

    Raises:
        FileNotFoundError: a file or folder is not there, or a folder holds no recording.
        NotARecordingError, DamagedRecordingError: a file is no recording, or cut or changed.
    """
    paths = [path] if isinstance(path, str | os.PathLike) else path
    arrays = TRAJECTORY_COLUMNS if trajectories else ()
    rows: list[dict[str, Any]] = []
    for place in map(Path, paths):
        for file in recordings_in(place) if place.is_dir() else [place]:
            facts = [] if trajectories else _facts_of_complete_file(file)
            read = ((one, None) for one in facts) if facts else _rollouts(existing_recording(file))
            for one, rollout in read:
                values = {name: getattr(rollout, name) for name in arrays}
                rows.append({"file": str(file)} | messages.table_row(one) | values)
    return pd.DataFrame(rows, columns=[*COLUMNS, *arrays]).astype(COLUMNS)


def read_metadata(path: PathLike) -> dict[str, str]:
    """The metadata given to ``write_recording``.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: as for ``read_recording``.
    """
    file = existing_recording(path)
    with file.open("rb") as stream, _damage_named(file):
        for record in NonSeekingReader(stream).iter_metadata():  # they precede the first message
            if record.name == messages.METADATA:
                return dict(record.metadata)
    return {}


def existing_recording(path: PathLike) -> Path:
    """The path of a file that exists and begins and ends as an MCAP.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: it does not.
    """
    file = Path(path)
    if not file.is_file():
        near = sorted(other.name for other in file.parent.glob("*.mcap"))
        there = f"; recordings beside it: {', '.join(near)}" if near else ""
        kind = "a folder, not a file" if file.is_dir() else "not there"
        raise FileNotFoundError(f"recording {file} is {kind}{there}")
    with file.open("rb") as stream:
        begin = stream.read(len(MAGIC))
        if not MAGIC.startswith(begin):  # a cut one may begin with less
            raise NotARecordingError(
                f"{file} is not an MCAP file: it begins with {begin!r} instead of {MAGIC!r}"
            )
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(len(begin), size - len(MAGIC)))
        if stream.read() != MAGIC:
            raise DamagedRecordingError(file, f"it is cut after {size} bytes")
    return file


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


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turns whatever the mcap library raises into a ``DamagedRecordingError``."""
    try:
        yield
    except _UNREADABLE as error:
        raise DamagedRecordingError(path, str(error) or type(error).__name__) from error


class _Frames:
    """A ``knotflow.Rollout`` and those of its frames that were read so far."""

    def __init__(self, facts: Any) -> None:
        self.facts = facts
        self.log_times: list[int] = []
        self.by_topic: dict[str, list[Any]] = {topic: [] for topic in _DECODERS}

    def add(self, topic: str, log_time: int, data: bytes) -> None:
        self.by_topic[topic].append(_DECODERS[topic](data))
        if topic == messages.ROPE:
            self.log_times.append(log_time)

    @property
    def complete(self) -> bool:
        ropes, grippers = self.by_topic[messages.ROPE], self.by_topic[messages.GRIPPER]
        return len(ropes) == len(grippers) == self.facts.frames

    def rollout(self) -> RecordedRollout:
        ropes, grippers, images, estimates, references = self.by_topic.values()
        camera = None
        if images:
            reference = np.array(references) if references else None
            camera = RolloutImages(tuple(images), np.array(estimates), reference)
        return messages.decode_rollout(
            self.facts, self.log_times, np.array(ropes), np.array(grippers), camera
        )


def _rollouts(path: Path) -> Iterator[tuple[Any, RecordedRollout]]:
    waiting: list[_Frames] = []  # by start time, which is also the order of the file
    read = 0
    for topic, log_time, data in _messages(path):
        with _damage_named(path):
            if topic == messages.ROLLOUT:
                waiting.append(_Frames(messages.RolloutMessage.FromString(data)))
                continue
            at = bisect_right(waiting, log_time, key=lambda frames: frames.facts.start_ns) - 1
            owner = waiting[at].facts if at >= 0 else None
            if owner is None or log_time > owner.start_ns + owner.duration_ns:
                continue  # a recovered file may have lost the facts of these frames
            waiting[at].add(topic, log_time, data)
            if not waiting[at].complete:
                continue
            rollout = waiting.pop(at).rollout()
        read += 1
        yield owner, rollout
    if read == 0:
        raise NotARecordingError(
            f"{path} is an MCAP without a single whole rollout: a recording has the topics "
            f"{messages.ROLLOUT}, {messages.ROPE} and {messages.GRIPPER}"
        )
    if waiting:
        warnings.warn(
            f"{path} announces {len(waiting)} rollouts without all of their frames, as recovered "
            f"recordings do; {read} whole ones were read",
            stacklevel=2,
        )


def _messages(path: Path) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns and encoded data of each message with facts or a frame."""
    with path.open("rb") as stream, _damage_named(path):
        reader = NonSeekingReader(stream, validate_crcs=True)  # reads nothing unchecked
        wanted = (messages.ROLLOUT, *_DECODERS)
        for _, channel, message in reader.iter_messages(wanted, log_time_order=False):
            yield channel.topic, message.log_time, message.data


def _facts_of_complete_file(path: Path) -> list[Any]:
    """Each ``knotflow.Rollout`` of a file whose summary accounts for every frame, else none."""
    with existing_recording(path).open("rb") as stream, _damage_named(path):
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            return []
        found = reader.iter_messages(messages.ROLLOUT, log_time_order=False)
        facts = [messages.RolloutMessage.FromString(message.data) for _, _, message in found]
    counts = {
        summary.channels[channel].topic: count
        for channel, count in summary.statistics.channel_message_counts.items()
    }
    frames = sum(each.frames for each in facts)
    return facts if counts.get(messages.ROPE) == counts.get(messages.GRIPPER) == frames else []

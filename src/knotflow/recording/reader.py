"""Recordings read back, as rollouts or as a pandas table, with every checksum of the messages
compared."""

from __future__ import annotations

import os
import struct
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.writer import MCAP0_MAGIC as MAGIC

from . import messages
from .rollout import RecordedRollout, RolloutImages

# What mcap and the codecs under it raise on changed bytes.
_UNREADABLE = (
    *(McapError, DecodeError, struct.error, zstandard.ZstdError),
    *(ValueError, LookupError, OverflowError, MemoryError),
    RuntimeError,  # LZ4
)
_DECODERS = {
    messages.ROPE: messages.cloud_points,
    messages.GRIPPER: messages.gripper_position,
    messages.CAMERA: lambda data: CompressedImage.FromString(data).data,
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
    """A recording was cut or changed after it was written."""

    def __init__(self, path: Path, reason: object) -> None:
        super().__init__(f"{path} is damaged: {reason}")


def read_recording(path: PathLike) -> Iterator[RecordedRollout]:
    """The rollouts of a recording, in file order, one in memory at a time.

    Trajectories come back as the exact float32 numbers that were written, splines and control
    points as the exact float64, times to 1 ns.

    Raises:
        FileNotFoundError: there is no such file (raised at once, not at the first rollout).
        NotARecordingError: it is no MCAP (at once), or holds no rollout.
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
            for one, rollout in (_rollouts if trajectories else _facts)(existing_recording(file)):
                values = {name: getattr(rollout, name) for name in arrays}
                rows.append({"file": str(file)} | messages.table_row(one) | values)
    return pd.DataFrame(rows, columns=[*COLUMNS, *arrays]).astype(COLUMNS)


def read_metadata(path: PathLike) -> dict[str, str]:
    """The metadata given to ``write_recording``; raises as ``read_recording``."""
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


def _rollouts(path: Path) -> Iterator[tuple[Any, RecordedRollout]]:
    """Each ``knotflow.Rollout`` and its rollout; in the file the frames follow in the same order,
    those of one rollout after those of another."""
    announced: deque[Any] = deque()
    frames: dict[str, list[Any]] = {topic: [] for topic in _DECODERS}
    log_times: list[int] = []
    # A reader that does not seek leaves nothing unchecked.
    for topic, log_time, data in _messages(path, NonSeekingReader, messages.ROLLOUT, *_DECODERS):
        with _damage_named(path):
            if topic == messages.ROLLOUT:
                announced.append(messages.RolloutMessage.FromString(data))
                continue
            frames[topic].append(_DECODERS[topic](data))
            if topic == messages.ROPE:
                log_times.append(log_time)
            if topic != messages.GRIPPER or len(log_times) < announced[0].frames:
                continue
            facts = announced.popleft()
            images = tuple(frames.pop(messages.CAMERA))
            ropes, grippers, estimate, reference = map(np.array, frames.values())
            camera = None
            if images:
                camera = RolloutImages(images, estimate, reference if len(reference) else None)
            rollout = messages.decode_rollout(facts, log_times, ropes, grippers, camera)
            frames, log_times = {topic: [] for topic in _DECODERS}, []
        yield facts, rollout
    if announced:
        raise DamagedRecordingError(path, f"{len(announced)} rollouts lack frames")


def _facts(path: Path) -> Iterator[tuple[Any, None]]:
    """Each ``knotflow.Rollout``, without reading the frames."""
    for _, _, data in _messages(path, SeekingReader, messages.ROLLOUT):
        with _damage_named(path):
            facts = messages.RolloutMessage.FromString(data)
        yield facts, None


def _messages(
    path: Path, reader: type[NonSeekingReader | SeekingReader], *topics: str
) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns and encoded data of messages of `topics`, the first rollout first."""
    found = False
    with path.open("rb") as stream, _damage_named(path):
        messages_of = reader(stream, validate_crcs=True).iter_messages
        for _, channel, message in messages_of(topics, log_time_order=False):
            found |= channel.topic == messages.ROLLOUT
            if found:
                yield channel.topic, message.log_time, message.data
    if not found:
        raise NotARecordingError(
            f"{path} is an MCAP without a single rollout ({messages.ROLLOUT}); the log of a run is "
            f"opened by `rerun {path}` or Foxglove"
        )

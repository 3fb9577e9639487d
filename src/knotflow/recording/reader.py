"""Reading recorded rollouts back, with the mcap library and every checksum compared.

A cut or changed file is an error here; its repair is left to the mcap command (`mcap recover`).
"""

from __future__ import annotations

import os
import struct
import warnings
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
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


class NotARecordingError(ValueError):
    """The file is no MCAP at all, or an MCAP in which no rollout was ever recorded."""


class DamagedRecordingError(ValueError):
    """A recording was cut or changed after it was written; names the command that repairs it."""

    def __init__(self, path: Path, reason: object) -> None:
        super().__init__(
            f"{path} is damaged: {reason}. What can be saved of it is saved by "
            f"`mcap recover {path.name} -o recovered.mcap` (https://mcap.dev/guides/cli)"
        )


def read_recording(path: str | os.PathLike[str]) -> Iterator[RecordedRollout]:
    """The rollouts of a recording, in file order, one in memory at a time.

    Trajectories come back as the exact float32 numbers that were written, splines and control
    points as the exact float64, times to 1 ns. A recovered file may announce rollouts whose
    frames are lost: these are left out, with a warning that counts them.

    Raises:
        FileNotFoundError: there is no such file (raised at once, not at the first rollout).
        NotARecordingError: it is no MCAP (at once), or holds no whole rollout.
        DamagedRecordingError: it is cut (at once), or a checksum is wrong (where this is met).
    """
    return (rollout for _, rollout in read_with_facts(path))


def read_with_facts(path: str | os.PathLike[str]) -> Iterator[tuple[Any, RecordedRollout]]:
    """As ``read_recording``, each rollout with its ``knotflow.Rollout``."""
    return _rollouts(existing_recording(path))


def read_metadata(path: str | os.PathLike[str]) -> dict[str, str]:
    """The metadata given to ``write_recording``.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: as for ``read_recording``.
    """
    file = existing_recording(path)
    with file.open("rb") as stream, damage_named(file):
        for record in NonSeekingReader(stream).iter_metadata():  # they precede the first message
            if record.name == messages.METADATA:
                return dict(record.metadata)
    return {}


def existing_recording(path: str | os.PathLike[str]) -> Path:
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


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Turns whatever the mcap library raises into a ``DamagedRecordingError``."""
    try:
        yield
    except _UNREADABLE as error:
        raise DamagedRecordingError(path, str(error) or type(error).__name__) from error


class _Frames:
    """The frames of a rollout that were read so far, and its ``knotflow.Rollout``."""

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
        with damage_named(path):
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
    with path.open("rb") as stream, damage_named(path):
        reader = NonSeekingReader(stream, validate_crcs=True)  # reads nothing unchecked
        wanted = (messages.ROLLOUT, *_DECODERS)
        for _, channel, message in reader.iter_messages(wanted, log_time_order=False):
            yield channel.topic, message.log_time, message.data
